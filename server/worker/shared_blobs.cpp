#include "server/worker/shared_blobs.h"

#include "client/lib/checksum.h"

#include <fstream>
#include <vector>

namespace saltus::worker {
namespace fs = std::filesystem;

bool copy_shared_blob(const fs::path& blobs, const std::string& digest, const fs::path& file) {
  const std::string prefix = "sha256:";
  // The two first digits are a folder.
  if (!digest.starts_with(prefix) || digest.find('/') != std::string::npos || digest.size() < prefix.size() + 3)
    return false;
  const std::string hex = digest.substr(prefix.size());
  std::ifstream from(blobs / hex.substr(0, 2) / hex.substr(2), std::ios::binary);
  if (!from) return false;
  std::ofstream to(file, std::ios::binary | std::ios::trunc);
  client::Sha256 hash;
  std::vector<char> bytes(1 << 20);
  while (from) {
    from.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    hash.add({bytes.data(), static_cast<std::size_t>(from.gcount())});
    to.write(bytes.data(), from.gcount());
  }
  to.close();
  if (to && from.eof() && hash.digest() == digest) return true;
  std::error_code ignored;  // it is written anew
  fs::remove(file, ignored);
  return false;
}

}  // namespace saltus::worker
