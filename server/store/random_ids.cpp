#include "server/store/random_ids.h"

#include "server/store/hex.h"
#include "server/store/sha256.h"

#include <openssl/rand.h>

#include <array>
#include <stdexcept>

namespace saltus::server {
namespace {

template <std::size_t Size>
std::string random_hex() {
  std::array<unsigned char, Size> bytes;
  if (RAND_bytes(bytes.data(), Size) != 1) throw std::runtime_error("the operating system gives no random numbers");
  return to_hex(bytes.data(), Size);
}

}  // namespace

std::string RandomIds::new_job_id(WallTime now) {
  const auto time = static_cast<unsigned long long>(now.time_since_epoch().count());
  std::array<unsigned char, 6> bytes;  // milliseconds in 48 bits, so that ids sort by time
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<unsigned char>(time >> (8 * (5 - i)));
  return to_hex(bytes.data(), bytes.size()) + "-" + random_hex<6>();
}

std::string RandomIds::new_token() { return random_hex<32>(); }

std::string RandomIds::fingerprint(const std::string& text) const {
  Sha256 hash;
  hash.add(text);
  return hash.hex();
}

}  // namespace saltus::server
