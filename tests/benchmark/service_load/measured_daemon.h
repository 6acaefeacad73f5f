#pragma once

#include "saltus/v1/registration.grpc.pb.h"
#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"

#include <grpcpp/channel.h>

#include <sys/types.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace saltus::benchmark {

/// A saltusd with a folder of its own, and the calls that every measurement makes. Its calls may come from several
/// threads once prepare() has returned.
class MeasuredDaemon {
 public:
  /// `options`: beside --data.
  MeasuredDaemon(std::string program, std::vector<std::string> options)
      : program_(std::move(program)), options_(std::move(options)) {}

  /// Waits until it serves. Once more after kill(): on the same folder, under another connection.
  void start();
  void kill();
  /// Throws std::runtime_error when it does not end in order.
  void stop();

  /// Uploads the two images that all jobs register.
  void prepare(const std::string& fixed, const std::string& moving);
  /// Queues one more job and returns its id.
  std::string create() const;
  void cancel(const std::string& id) const;

  pid_t id() const { return process_->id(); }
  const std::string& address() const { return address_; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  const std::string program_;
  const std::vector<std::string> options_;
  testing_support::TemporaryFolder folder_;
  std::optional<testing_support::ChildProcess> process_;
  std::string address_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::RegistrationService::Stub> jobs_;
  v1::CreateRegistrationJobRequest request_;
};

}  // namespace saltus::benchmark
