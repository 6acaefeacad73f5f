#include "client/cli/watch_command.h"

#include "client/cli/connection.h"
#include "client/cli/job_output.h"
#include "client/cli/output_errors.h"
#include "client/cli/progress_display.h"
#include "client/cli/run_job.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>

namespace saltus::cli {
namespace {

struct WatchOptions {
  std::string id;
  ServerChoice server;
  bool as_json = false;
};

int watch(const WatchOptions& options) {
  client::RegistrationClient client(call_settings(options.server));
  v1::RegistrationJob job;
  if (options.as_json) {
    job = client.watch(options.id, [](const v1::RegistrationJob& now) {
      std::cout << job_json(now).dump() << std::endl;
      // Nobody reads on, so there is nobody to watch for.
      if (!has_output_arrived())
        throw FileError("standard output cannot be written, so job " + now.id() +
                        " is not watched any more; it goes on");
    });
  } else {
    ProgressDisplay display(std::cerr, display_style_of_stderr());
    job = client.watch(options.id, [&display](const v1::RegistrationJob& now) { display.show(now); });
  }
  return exit_code_of(job);
}

}  // namespace

void add_watch_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("watch", "Follow a job until it ends");
  auto options = std::make_shared<WatchOptions>();
  command->add_option("id", options->id, "Id of the job")->required();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print each state as one line of JSON");
  command->footer(
      "Ctrl-C ends the watching, not the job. The exit code is that of the job: 0 succeeded, 1 failed, 4 cancelled.\n"
      "Example:\n"
      "  saltus watch 0192f3a4 --server unix:/run/saltusd/socket");
  command->callback([options, &exit_code] { exit_code = watch(*options); });
}

}  // namespace saltus::cli
