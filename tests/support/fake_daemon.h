#pragma once

#include "client/lib/channel.h"
#include "client/lib/checksum.h"

#include "tests/support/temporary_folder.h"

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <initializer_list>
#include <memory>
#include <string>

namespace saltus::testing_support {

inline std::string digest_of(const std::string& data) {
  client::Sha256 sha;
  sha.add(data);
  return sha.digest();
}

/// Serves what a test gives it on a unix socket of its own, until destroyed.
class FakeDaemon {
 public:
  explicit FakeDaemon(std::initializer_list<grpc::Service*> services) : FakeDaemon("", services) {}
  FakeDaemon(const std::string& address, std::initializer_list<grpc::Service*> services)
      : address_(address.empty() ? "unix:" + (folder_ / "socket").string() : address) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort(address_, grpc::InsecureServerCredentials());
    for (grpc::Service* service : services) builder.RegisterService(service);
    server_ = builder.BuildAndStart();
  }
  ~FakeDaemon() { server_->Shutdown(std::chrono::system_clock::now()); }

  client::CallSettings settings() const {
    client::CallSettings settings{.address = address_, .retry = {}, .stop = {}};
    settings.retry.first_delay = std::chrono::milliseconds(1);
    return settings;
  }

 private:
  TemporaryFolder folder_;
  std::string address_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace saltus::testing_support
