#include "server/rpc/listener.h"

#include "core/support/errors.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <cerrno>
#include <cstring>
#include <memory>

namespace saltus::server {
namespace {

template <auto function>
struct Freed {
  template <class T>
  void operator()(T* object) const {
    function(object);
  }
};
using File = std::unique_ptr<BIO, Freed<BIO_free>>;
using Certificate = std::unique_ptr<X509, Freed<X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Freed<EVP_PKEY_free>>;

File open(const char* option, const std::string& path) {
  File file(BIO_new_file(path.c_str(), "r"));
  if (!file)
    throw InvalidInput(std::string(option) + " is " + path + ", which cannot be read: " + std::strerror(errno));
  return file;
}

Certificate read_certificate(const char* option, const std::string& path) {
  const File file = open(option, path);
  Certificate certificate(PEM_read_bio_X509(file.get(), nullptr, nullptr, nullptr));
  if (!certificate)
    throw InvalidInput(std::string(option) + " is " + path + ", which holds no certificate in PEM form");
  return certificate;
}

Key read_key(const char* option, const std::string& path) {
  const File file = open(option, path);
  // Nobody is there to type a pass phrase.
  pem_password_cb* const refuse = [](char*, int, int, void*) { return -1; };
  Key key(PEM_read_bio_PrivateKey(file.get(), nullptr, refuse, nullptr));
  if (!key)
    throw InvalidInput(std::string(option) + " is " + path +
                       ", which holds no private key in PEM form that opens without a pass phrase");
  return key;
}

}  // namespace

void require_usable(const TlsFiles& files) {
  const Certificate certificate = read_certificate("--tls-cert", files.certificate);
  const Key key = read_key("--tls-key", files.key);
  if (X509_check_private_key(certificate.get(), key.get()) != 1)
    throw InvalidInput("--tls-key is " + files.key + ", which is not the key of --tls-cert " + files.certificate);
  read_certificate("--tls-client-ca", files.client_authority);
}

std::shared_ptr<grpc::ServerCredentials> tls_credentials(const TlsFiles& files, const Authorisation& authorisation) {
  require_usable(files);
  const auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      files.key, files.certificate, files.client_authority, static_cast<unsigned>(files.reload_interval.count()));
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  auto credentials = grpc::experimental::TlsServerCredentials(options);
  credentials->SetAuthMetadataProcessor(authorisation.gate());
  return credentials;
}

}  // namespace saltus::server
