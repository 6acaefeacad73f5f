#include "client/lib/checksum.h"

#include "client/lib/client_error.h"

#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <vector>

namespace saltus::client {
namespace {

using CrcTables = std::array<std::array<std::uint32_t, 256>, 8>;

// Slicing by eight: table k advances a byte that is followed by k further bytes.
constexpr CrcTables make_crc_tables() {
  CrcTables tables{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t value = byte;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ ((value & 1) ? 0x82F63B78u : 0u);
    tables[0][byte] = value;
  }
  for (int k = 1; k < 8; ++k)
    for (std::uint32_t byte = 0; byte < 256; ++byte)
      tables[k][byte] = (tables[k - 1][byte] >> 8) ^ tables[0][tables[k - 1][byte] & 0xFF];
  return tables;
}
constexpr CrcTables crc_tables = make_crc_tables();

}  // namespace

std::uint32_t crc32c(std::string_view data) {
  std::uint32_t crc = ~0u;
  const auto* bytes = reinterpret_cast<const unsigned char*>(data.data());
  std::size_t left = data.size();
  for (; left >= 8; left -= 8, bytes += 8) {
    std::uint32_t low = 0, high = 0;
    for (int i = 3; i >= 0; --i) {
      low = (low << 8) | bytes[i];
      high = (high << 8) | bytes[4 + i];
    }
    low ^= crc;
    crc = 0;
    for (int i = 0; i < 4; ++i)
      crc ^= crc_tables[7 - i][(low >> (8 * i)) & 0xFF] ^ crc_tables[3 - i][(high >> (8 * i)) & 0xFF];
  }
  for (; left > 0; --left, ++bytes) crc = (crc >> 8) ^ crc_tables[0][(crc ^ *bytes) & 0xFF];
  return ~crc;
}

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
