#include "client/cli/get_command.h"

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

struct GetOptions {
  std::string id;
  ServerChoice server;
  bool as_json = false;
};

int get(const GetOptions& options) {
  client::RegistrationClient client(call_settings(options.server));
  const v1::RegistrationJob job = client.get(options.id);
  std::cout << (options.as_json ? job_json(job).dump(2) + "\n" : job_text(job)) << std::flush;
  return Done;
}

}  // namespace

void add_get_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("get", "Print what is known of a job");
  auto options = std::make_shared<GetOptions>();
  command->add_option("id", options->id, "Id of the job")->required();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print the job as JSON");
  command->footer("Example:\n  saltus get 0192f3a4 --json");
  command->callback([options, &exit_code] { exit_code = get(*options); });
}

}  // namespace saltus::cli
