#include "client/cli/register_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/interrupts.h"
#include "client/cli/job_options.h"
#include "client/cli/job_output.h"
#include "client/cli/private_daemon.h"
#include "client/cli/progress_display.h"
#include "client/cli/report_summary.h"
#include "client/cli/run_job.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <unistd.h>

#include <iostream>
#include <memory>
#include <mutex>
#include <optional>

namespace saltus::cli {
namespace {

struct RegisterOptions {
  JobOptions job;
  std::string out;
  ServerChoice server;
  bool as_json = false;
};

/// What an interrupt has to do depends on how far the command is: before there is a job, calls are cut off; while the
/// job is being made, nothing, since the answer must not be lost; then the job is cancelled. A second interrupt, or a
/// cancel that fails, cuts calls off.
class InterruptibleJob {
 public:
  InterruptibleJob() : interrupts_([this](int count) { on_interrupt(count); }) {}

  std::stop_token stop_token() const { return stop_.get_token(); }
  bool is_interrupted() const { return interrupts_.count() > 0; }

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

int register_on(const ServerChoice& server, const RegisterOptions& options, v1::RegistrationSpec spec,
                InterruptibleJob& interruptible, std::chrono::milliseconds watch_patience) {
  client::RegistrationClient client(call_settings(server, interruptible.stop_token()));
  upload_inputs(client, options.job, spec);
  v1::RegistrationJob job = interruptible.create(server, spec);
  {
    ProgressDisplay display(std::cerr, display_style_of_stderr());
    const auto show = [&display](const v1::RegistrationJob& now) { display.show(now); };
    job = client.watch(job.id(), show, watch_patience);
  }
  if (const int code = exit_code_of(job); code != Done) return code;
  fetch_artifacts(client, job, options.out);
  const nlohmann::json report = read_report(std::filesystem::path(options.out) / "report.json");
  if (options.as_json)
    std::cout << nlohmann::json{{"job", job_json(job)}, {"report", report}}.dump(2) << std::endl;
  else
    std::cout << report_summary(report) << "written to " << options.out << std::endl;
  return Done;
}

/// The folder for the result, made before the work: an hour's result must have somewhere to go. Taken away again when
/// it was made here and stays empty.
class ResultFolder {
 public:
  explicit ResultFolder(std::filesystem::path folder) : folder_(std::move(folder)) {
    std::error_code error;
    is_new_ = std::filesystem::create_directories(folder_, error);
    if (error || !std::filesystem::is_directory(folder_) || ::access(folder_.c_str(), W_OK) != 0)
      throw InvalidInput("--out is '" + folder_.string() + "', where no folder can be made or written (" +
                         (error ? error.message() : std::string("not a writable folder")) + "); name another one");
  }
  ~ResultFolder() {
    std::error_code not_empty;
    if (is_new_) std::filesystem::remove(folder_, not_empty);
  }
  ResultFolder(const ResultFolder&) = delete;
  ResultFolder& operator=(const ResultFolder&) = delete;

 private:
  std::filesystem::path folder_;
  bool is_new_ = false;
};

int register_images(const RegisterOptions& options) {
  if (wants_parameter_help(options.job)) {
    std::cout << parameter_table(options.job);
    return Done;
  }
  const v1::RegistrationSpec spec = make_spec(options.job);
  if (options.out.empty()) throw InvalidInput("--out is missing; name a folder for the result");
  const ResultFolder folder(options.out);
  // Made before the daemon and ended after it, so that no interrupt leaves its folder behind.
  InterruptibleJob interruptible;
  try {
    if (!options.server.address.empty())
      return register_on(options.server, options, spec, interruptible, std::chrono::seconds(60));
    const PrivateDaemon daemon;
    // Nobody restarts a private daemon: when it is gone, it stays away.
    return register_on({daemon.address(), {}, {}, {}}, options, spec, interruptible, std::chrono::seconds(2));
  } catch (const client::ClientError& error) {
    if (!interruptible.is_interrupted() || error.code() != grpc::StatusCode::CANCELLED) throw;
    std::cerr << "saltus: interrupted" << std::endl;
    return Cancelled;
  }
}

}  // namespace

void add_register_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("register", "Register two images and write the result to a folder");
  auto options = std::make_shared<RegisterOptions>();
  add_job_options(*command, options->job);
  command->add_option("--out", options->out, "Folder for the result, made if need be (required)")->type_name("DIR");
  // SALTUS_SERVER is for the commands that need a server; here none means a private one.
  command
      ->add_option("--server", options->server.address,
                   "Address of saltusd, unix:/path or host:port; without it a private one is started and stopped")
      ->type_name("ADDRESS");
  add_tls_options(*command, options->server);
  command->add_flag("--json", options->as_json, "Print job and report as JSON");
  command->footer(
      "Ctrl-C cancels the job. Exit codes: 0 done, 1 failed, 2 usage, 3 server not reachable, 4 cancelled.\n"
      "Examples:\n"
      "  saltus register --fixed exhale.nii.gz --moving inhale.nii.gz --out result\n"
      "  saltus register --fixed ct1.mha --moving ct2.mha --affine rigid --intensity-window -1000,400 \\\n"
      "      --fixed-mask body.mha --preset accurate --out result\n"
      "  saltus register --model wendland1 --set help");
  command->callback([options, &exit_code] { exit_code = register_images(*options); });
}

}  // namespace saltus::cli
