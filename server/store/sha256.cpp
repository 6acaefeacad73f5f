#include "server/store/sha256.h"

#include "server/store/hex.h"

#include <openssl/evp.h>

#include <stdexcept>

namespace saltus::server {
namespace {

void check(int result) {
  if (result != 1) throw std::runtime_error("SHA-256 is not available in this build of OpenSSL");
}

}  // namespace

void Sha256::Free::operator()(evp_md_ctx_st* context) const { EVP_MD_CTX_free(context); }

Sha256::Sha256() : context_(EVP_MD_CTX_new()) { check(EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr)); }

void Sha256::add(std::string_view bytes) { check(EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size())); }

std::string Sha256::hex() {
  unsigned char bytes[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  check(EVP_DigestFinal_ex(context_.get(), bytes, &size));
  return to_hex(bytes, size);
}

}  // namespace saltus::server
