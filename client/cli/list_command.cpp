#include "client/cli/list_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/job_output.h"
#include "client/cli/queue_options.h"
#include "client/lib/registration_client.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>

namespace saltus::cli {
namespace {

struct ListOptions {
  std::string state;
  std::vector<std::string> labels;
  int limit = 50;
  ServerChoice server;
  bool as_json = false;
};

int list(const ListOptions& options) {
  v1::ListRegistrationJobsRequest request;
  if (!options.state.empty()) request.set_state(parse_state(options.state));
  for (const auto& [name, value] : parse_labels(options.labels)) (*request.mutable_labels())[name] = value;
  client::RegistrationClient client(call_settings(options.server));
  const auto jobs = client.list(std::move(request), options.limit);
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
  command->add_option("--label", options->labels, "Only jobs with this label, may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--limit", options->limit, "How many at most")->check(CLI::PositiveNumber)->capture_default_str();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print a JSON array");
  command->footer("Example:\n  saltus list --state failed --label case=7");
  command->callback([options, &exit_code] { exit_code = list(*options); });
}

}  // namespace saltus::cli
