#pragma once

#include "tests/support/temporary_folder.h"

#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

namespace saltus::testing_support {

/// A certificate and its key, made now.
class Certificate {
 public:
  struct Options {
    std::string common_name;
    std::string alternative_names;  ///< as openssl writes them: "DNS:x, email:y"
    bool is_authority = false;
    int begins_after_seconds = -3600;
    int ends_after_seconds = 3600;
  };

  /// Signed by `issuer`, or by itself.
  explicit Certificate(const Options& options, const Certificate* issuer = nullptr)
      : key_(EVP_EC_gen("P-256"), EVP_PKEY_free), certificate_(X509_new(), X509_free) {
    static long serial = 0;
    X509* made = certificate_.get();
    X509_set_version(made, X509_VERSION_3);
    ASN1_INTEGER_set(X509_get_serialNumber(made), ++serial);
    X509_gmtime_adj(X509_getm_notBefore(made), options.begins_after_seconds);
    X509_gmtime_adj(X509_getm_notAfter(made), options.ends_after_seconds);
    X509_NAME_add_entry_by_txt(X509_get_subject_name(made), "CN", MBSTRING_UTF8,
                               reinterpret_cast<const unsigned char*>(options.common_name.c_str()), -1, -1, 0);
    const Certificate& authority = issuer ? *issuer : *this;
    X509_set_issuer_name(made, X509_get_subject_name(authority.certificate_.get()));
    X509_set_pubkey(made, key_.get());
    if (options.is_authority) extend(NID_basic_constraints, "critical,CA:TRUE");
    if (!options.alternative_names.empty()) extend(NID_subject_alt_name, options.alternative_names);
    if (X509_sign(made, authority.key_.get(), EVP_sha256()) == 0) throw std::runtime_error("cannot sign");
  }

  std::string pem() const {
    return written([this](BIO* out) { PEM_write_bio_X509(out, certificate_.get()); });
  }
  std::string key_pem() const {
    return written(
        [this](BIO* out) { PEM_write_bio_PrivateKey(out, key_.get(), nullptr, nullptr, 0, nullptr, nullptr); });
  }

 private:
  void extend(int kind, const std::string& value) {
    X509_EXTENSION* extension = X509V3_EXT_conf_nid(nullptr, nullptr, kind, value.c_str());
    if (!extension) throw std::runtime_error("cannot extend a certificate by " + value);
    X509_add_ext(certificate_.get(), extension, -1);
    X509_EXTENSION_free(extension);
  }
  template <class Write>
  static std::string written(Write write) {
    const std::unique_ptr<BIO, decltype(&BIO_free)> out(BIO_new(BIO_s_mem()), BIO_free);
    write(out.get());
    char* bytes = nullptr;
    const long size = BIO_get_mem_data(out.get(), &bytes);
    return {bytes, static_cast<std::size_t>(size)};
  }

  std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key_;
  std::unique_ptr<X509, decltype(&X509_free)> certificate_;
};

/// An authority and what it has issued, as a small hospital would have it.
struct Authority {
  Certificate root{{.common_name = "test authority", .alternative_names = "", .is_authority = true}};

  Certificate issue(const std::string& common_name, const std::string& alternative_names = "") const {
    return Certificate({.common_name = common_name, .alternative_names = alternative_names}, &root);
  }
  /// For a daemon on this machine.
  Certificate server(const std::string& name = "saltusd") const { return issue(name, "DNS:localhost, IP:127.0.0.1"); }
};

}  // namespace saltus::testing_support
