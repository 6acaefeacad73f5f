#include "client/cli/registrar.h"

#include "client/cli/interrupts.h"
#include "client/cli/run_job.h"
#include "core/support/errors.h"

#include <unistd.h>

#include <iostream>
#include <mutex>
#include <optional>
#include <vector>

namespace saltus::cli {

/// What an interrupt has to do depends on how far a job is: before there is one, calls are cut off; while the job is
/// being made, nothing, since the answer must not be lost; then the job is cancelled. A second interrupt, or a cancel
/// that fails, cuts calls off.
class InterruptibleJobs {
 public:
  /// A job from before it is made until it has ended.
  struct Run {
    std::stop_source stop;
    std::optional<client::RegistrationClient> client;  ///< from the moment the job is being made; has no stop token
    std::optional<std::string> id;
  };

  InterruptibleJobs() : interrupts_([this](int count) { on_interrupt(count); }) {}

  bool is_interrupted() const { return interrupts_.count() > 0; }

  /// Throws ClientError CANCELLED when interrupted already.
  std::shared_ptr<Run> begin() {
    std::lock_guard lock(mutex_);
    refuse_if_interrupted();
    auto run = std::make_shared<Run>();
    std::erase_if(runs_, [](const std::weak_ptr<Run>& one) { return one.expired(); });
    runs_.push_back(run);
    return run;
  }

  v1::RegistrationJob create(Run& run, const ServerChoice& server, const v1::RegistrationSpec& spec) {
    {
      std::lock_guard lock(mutex_);
      refuse_if_interrupted();
      run.client.emplace(call_settings(server));
    }
    const v1::RegistrationJob job = run.client->create(spec);
    std::lock_guard lock(mutex_);
    run.id = job.id();
    if (is_interrupted()) cancel(run);
    return job;
  }

 private:
  void refuse_if_interrupted() const {
    if (is_interrupted()) throw client::ClientError(grpc::StatusCode::CANCELLED, "STOPPED", "interrupted");
  }
  void on_interrupt(int count) {
    std::lock_guard lock(mutex_);
    for (const std::weak_ptr<Run>& one : runs_) {
      const std::shared_ptr<Run> run = one.lock();
      if (!run) continue;
      if (count > 1 || !run->client)
        run->stop.request_stop();
      else if (run->id)
        cancel(*run);
    }
  }
  static void cancel(Run& run) {
    try {
      run.client->cancel(*run.id);
    } catch (const client::ClientError& error) {
      std::cerr << "saltus: job " << *run.id << " could not be cancelled: " << error.what() << std::endl;
      run.stop.request_stop();
    }
  }

  std::mutex mutex_;
  std::vector<std::weak_ptr<Run>> runs_;
  Interrupts interrupts_;
};

struct Registrar::Parts {
  // Made before the daemon and ended after it, so that no interrupt leaves its folder behind.
  InterruptibleJobs interruptible;
  std::optional<PrivateDaemon> daemon;
  ServerChoice server;
  // Nobody restarts a private daemon: when it is gone, it stays away.
  std::chrono::milliseconds watch_patience = std::chrono::seconds(60);
};

Registrar::Registrar(ServerChoice server, const PrivateDaemon::Work& work) : parts_(std::make_unique<Parts>()) {
  parts_->server = std::move(server);
  if (!parts_->server.address.empty()) return;
  parts_->daemon.emplace(work);
  parts_->server = {
      parts_->daemon->address(), {}, {}, {}, {.folder = parts_->daemon->blobs(), .are_ours = work.is_one_pair}};
  parts_->watch_patience = std::chrono::seconds(2);
}

Registrar::~Registrar() = default;

v1::RegistrationJob Registrar::run(const JobOptions& options, v1::RegistrationSpec spec,
                                   const std::filesystem::path& out, const Show& show) {
  const auto run = parts_->interruptible.begin();
  client::RegistrationClient client(call_settings(parts_->server, run->stop.get_token()));
  upload_inputs(client, options, spec);
  v1::RegistrationJob job = parts_->interruptible.create(*run, parts_->server, spec);
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
