#include "client/cli/list_command.h"

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

struct ListOptions {
  std::string state;
  int limit = 50;
  ServerChoice server;
  bool as_json = false;
};

int list(const ListOptions& options) {
  const v1::JobState state = options.state.empty() ? v1::JOB_STATE_UNSPECIFIED : parse_state(options.state);
  client::RegistrationClient client(call_settings(options.server));
  const auto jobs = client.list(state, options.limit);
  if (options.as_json) {
    nlohmann::json json = nlohmann::json::array();
    for (const auto& job : jobs) json.push_back(job_json(job));
    std::cout << json.dump(2) << std::endl;
  } else {
    std::cout << job_table(jobs) << std::flush;
  }
  return Done;
}

}  // namespace

void add_list_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("list", "Print the newest jobs of a server");
  auto options = std::make_shared<ListOptions>();
  command->add_option("--state", options->state, "Only jobs in this state, e.g. running");
  command->add_option("--limit", options->limit, "How many at most")->check(CLI::PositiveNumber)->capture_default_str();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print a JSON array");
  command->footer("Example:\n  saltus list --state failed --limit 10");
  command->callback([options, &exit_code] { exit_code = list(*options); });
}

}  // namespace saltus::cli
