#pragma once

#include "client/cli/connection.h"
#include "client/cli/job_options.h"
#include "client/cli/private_daemon.h"

#include <filesystem>
#include <functional>
#include <memory>

namespace saltus::cli {

/// Runs registrations on a server or, when no address is given, on a private daemon that lives as long as this object.
/// Ctrl-C cancels the jobs that run; later ones are not begun. One object at a time, since it holds the handlers of the
/// interrupts; its `run` may be called by several threads at once.
class Registrar {
 public:
  /// `work` is for the private daemon. Throws what PrivateDaemon and call_settings throw; ClientError CANCELLED when
  /// interrupted meanwhile.
  explicit Registrar(ServerChoice server, const PrivateDaemon::Work& work = {});
  ~Registrar();
  Registrar(const Registrar&) = delete;
  Registrar& operator=(const Registrar&) = delete;

  using Show = std::function<void(const v1::RegistrationJob&)>;

  /// Sends the images, makes the job, follows it, and, when it has succeeded, fetches what it made into `out`. The job
  /// in its terminal state. Throws ClientError, CANCELLED when interrupted before there was a job.
  v1::RegistrationJob run(const JobOptions& options, v1::RegistrationSpec spec, const std::filesystem::path& out,
                          const Show& show);

  bool is_interrupted() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// The folder for a result, made before the work: an hour's result must have somewhere to go. Taken away again when it
/// was made here and stays empty.
class ResultFolder {
 public:
  /// Throws InvalidInput when it cannot be made or written.
  explicit ResultFolder(std::filesystem::path folder);
  ~ResultFolder();
  ResultFolder(const ResultFolder&) = delete;
  ResultFolder& operator=(const ResultFolder&) = delete;

 private:
  std::filesystem::path folder_;
  bool is_new_ = false;
};

}  // namespace saltus::cli
