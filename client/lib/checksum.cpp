#include "client/lib/checksum.h"

#include "client/lib/client_error.h"

#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <vector>

namespace saltus::client {
struct Sha256::Context {
  EVP_MD_CTX* handle = EVP_MD_CTX_new();
  ~Context() { EVP_MD_CTX_free(handle); }
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {
  if (!context_->handle || EVP_DigestInit_ex(context_->handle, EVP_sha256(), nullptr) != 1)
    throw std::runtime_error("OpenSSL offers no SHA-256");
}

Sha256::~Sha256() = default;

void Sha256::add(std::string_view data) {
  if (EVP_DigestUpdate(context_->handle, data.data(), data.size()) != 1)
    throw std::runtime_error("OpenSSL could not continue a SHA-256");
}

std::string Sha256::digest() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> bytes;
  unsigned int length = 0;
  if (EVP_DigestFinal_ex(context_->handle, bytes.data(), &length) != 1)
    throw std::runtime_error("OpenSSL could not finish a SHA-256");
  std::string text = "sha256:";
  for (unsigned int i = 0; i < length; ++i) {
    text += "0123456789abcdef"[bytes[i] >> 4];
    text += "0123456789abcdef"[bytes[i] & 15];
  }
  return text;
}

FileDigest digest_of_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw LocalFileError(file.string() + " cannot be read: " + std::strerror(errno));
  Sha256 sha;
  FileDigest result;
  std::vector<char> buffer(1 << 20);
  while (in.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || in.gcount() > 0) {
    sha.add({buffer.data(), static_cast<std::size_t>(in.gcount())});
    result.size += in.gcount();
  }
  if (in.bad()) throw LocalFileError(file.string() + " cannot be read to its end: " + std::strerror(errno));
  result.digest = sha.digest();
  return result;
}

}  // namespace saltus::client
