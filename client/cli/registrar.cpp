#include "client/cli/registrar.h"

#include "client/cli/interrupts.h"
#include "client/cli/private_daemon.h"
#include "client/cli/run_job.h"
#include "core/support/errors.h"

#include <unistd.h>

#include <iostream>
#include <mutex>
#include <optional>

namespace saltus::cli {
namespace {

/// What an interrupt has to do depends on how far the command is: before there is a job, calls are cut off; while the
/// job is being made, nothing, since the answer must not be lost; then the job is cancelled. A second interrupt, or a
/// cancel that fails, cuts calls off.
class InterruptibleJob {
 public:
  InterruptibleJob() : interrupts_([this](int count) { on_interrupt(count); }) {}

  std::stop_token stop_token() const { return stop_.get_token(); }
  bool is_interrupted() const { return interrupts_.count() > 0; }

  /// Before the next job: what is interrupted now has no job to cancel.
  void begin() {
    std::lock_guard lock(mutex_);
    if (is_interrupted()) throw client::ClientError(grpc::StatusCode::CANCELLED, "STOPPED", "interrupted");
    client_.reset();
    id_.reset();
  }

  v1::RegistrationJob create(const ServerChoice& server, const v1::RegistrationSpec& spec) {
    {
      std::lock_guard lock(mutex_);
      if (is_interrupted()) throw client::ClientError(grpc::StatusCode::CANCELLED, "STOPPED", "interrupted");
      client_.emplace(call_settings(server));
    }
    const v1::RegistrationJob job = client_->create(spec);
    std::lock_guard lock(mutex_);
    id_ = job.id();
    if (is_interrupted()) cancel();
    return job;
  }

 private:
  void on_interrupt(int count) {
    std::lock_guard lock(mutex_);
    if (count > 1 || !client_)
      stop_.request_stop();
    else if (id_)
      cancel();
  }
  void cancel() {
    try {
      client_->cancel(*id_);
    } catch (const client::ClientError& error) {
      std::cerr << "saltus: job " << *id_ << " could not be cancelled: " << error.what() << std::endl;
      stop_.request_stop();
    }
  }

  std::mutex mutex_;
  std::stop_source stop_;
  std::optional<client::RegistrationClient> client_;  ///< from the moment the job is being made; has no stop token
  std::optional<std::string> id_;
  Interrupts interrupts_;
};

}  // namespace

struct Registrar::Parts {
  // Made before the daemon and ended after it, so that no interrupt leaves its folder behind.
  InterruptibleJob interruptible;
  std::optional<PrivateDaemon> daemon;
  ServerChoice server;
  // Nobody restarts a private daemon: when it is gone, it stays away.
  std::chrono::milliseconds watch_patience = std::chrono::seconds(60);
};

Registrar::Registrar(ServerChoice server) : parts_(std::make_unique<Parts>()) {
  parts_->server = std::move(server);
  if (!parts_->server.address.empty()) return;
  parts_->daemon.emplace();
  parts_->server = {parts_->daemon->address(), {}, {}, {}};
  parts_->watch_patience = std::chrono::seconds(2);
}

Registrar::~Registrar() = default;

v1::RegistrationJob Registrar::run(const JobOptions& options, v1::RegistrationSpec spec,
                                   const std::filesystem::path& out, const Show& show) {
  InterruptibleJob& interruptible = parts_->interruptible;
  interruptible.begin();
  client::RegistrationClient client(call_settings(parts_->server, interruptible.stop_token()));
  upload_inputs(client, options, spec);
  v1::RegistrationJob job = interruptible.create(parts_->server, spec);
  job = client.watch(job.id(), show, parts_->watch_patience);
  if (job.state() == v1::JOB_STATE_SUCCEEDED) fetch_artifacts(client, job, out);
  return job;
}

bool Registrar::is_interrupted() const { return parts_->interruptible.is_interrupted(); }

ResultFolder::ResultFolder(std::filesystem::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  is_new_ = std::filesystem::create_directories(folder_, error);
  if (error || !std::filesystem::is_directory(folder_) || ::access(folder_.c_str(), W_OK) != 0)
    throw InvalidInput("--out is '" + folder_.string() + "', where no folder can be made or written (" +
                       (error ? error.message() : std::string("not a writable folder")) + "); name another one");
}

ResultFolder::~ResultFolder() {
  std::error_code not_empty;
  if (is_new_) std::filesystem::remove(folder_, not_empty);
}

}  // namespace saltus::cli
