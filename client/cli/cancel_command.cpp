#include "client/cli/cancel_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/job_output.h"
#include "client/lib/registration_client.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>

namespace saltus::cli {
namespace {

struct CancelOptions {
  std::string id;
  ServerChoice server;
  bool as_json = false;
};

int cancel(const CancelOptions& options) {
  client::RegistrationClient client(call_settings(options.server));
  const v1::RegistrationJob job = client.cancel(options.id);
  if (options.as_json)
    std::cout << job_json(job).dump(2) << std::endl;
  else
    std::cout << "job " << job.id() << " is " << state_name(job.state()) << std::endl;
  return Done;
}

}  // namespace

void add_cancel_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("cancel", "Ask for a job's end; a job that has ended stays as it is");
  auto options = std::make_shared<CancelOptions>();
  command->add_option("id", options->id, "Id of the job")->required();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print the job as JSON");
  command->footer("Example:\n  saltus cancel 0192f3a4 && saltus watch 0192f3a4");
  command->callback([options, &exit_code] { exit_code = cancel(*options); });
}

}  // namespace saltus::cli
