#include "client/cli/delete_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/lib/registration_client.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>

namespace saltus::cli {
namespace {

struct DeleteOptions {
  std::string id;
  ServerChoice server;
  bool as_json = false;
};

int delete_job(const DeleteOptions& options) {
  client::RegistrationClient client(call_settings(options.server));
  client.remove(options.id);
  if (options.as_json)
    std::cout << nlohmann::json{{"deleted", options.id}}.dump(2) << std::endl;
  else
    std::cout << "job " << options.id << " is deleted" << std::endl;
  return Done;
}

}  // namespace

void add_delete_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("delete", "Forget a job that has ended, and what it made");
  auto options = std::make_shared<DeleteOptions>();
  command->add_option("id", options->id, "Id of the job")->required();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print the id as JSON");
  command->footer("Example:\n  saltus delete 0192f3a4");
  command->callback([options, &exit_code] { exit_code = delete_job(*options); });
}

}  // namespace saltus::cli
