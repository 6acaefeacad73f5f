#include "client/cli/fetch_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/job_output.h"
#include "client/cli/run_job.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>

namespace saltus::cli {
namespace {

struct FetchOptions {
  std::string id;
  std::string out;
  ServerChoice server;
  bool as_json = false;
};

int fetch(const FetchOptions& options) {
  client::RegistrationClient client(call_settings(options.server));
  const v1::RegistrationJob job = client.get(options.id);
  if (!client::is_terminal(job.state())) {
    std::cerr << "saltus: job " << job.id() << " is " << state_name(job.state())
              << " and has made nothing yet; wait for it with: saltus watch " << job.id() << std::endl;
    return JobFailed;
  }
  if (const int code = exit_code_of(job); code != Done) return code;
  nlohmann::json json = nlohmann::json::array();
  for (const auto& file : fetch_artifacts(client, job, options.out)) {
    if (options.as_json)
      json.push_back(file.string());
    else
      std::cout << file.string() << '\n';
  }
  if (options.as_json) std::cout << json.dump(2) << '\n';
  std::cout << std::flush;
  return Done;
}

}  // namespace

void add_fetch_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("fetch", "Write what a job has made to a folder");
  auto options = std::make_shared<FetchOptions>();
  command->add_option("id", options->id, "Id of the job")->required();
  command->add_option("--out", options->out, "Folder for the files")->type_name("DIR")->required();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print the files as a JSON array");
  command->footer("Example:\n  saltus fetch 0192f3a4 --out result");
  command->callback([options, &exit_code] { exit_code = fetch(*options); });
}

}  // namespace saltus::cli
