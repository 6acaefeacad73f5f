#include "client/cli/submit_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/input_check.h"
#include "client/cli/job_options.h"
#include "client/cli/job_output.h"
#include "client/cli/output_errors.h"
#include "client/cli/queue_options.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>

namespace saltus::cli {
namespace {

struct SubmitOptions {
  JobOptions job;
  ServerChoice server;
  QueueOptions queue;
  bool as_json = false;
};

int submit(const SubmitOptions& options) {
  if (wants_parameter_help(options.job)) {
    std::cout << parameter_table(options.job);
    return Done;
  }
  v1::RegistrationSpec spec = make_spec(options.job);
  check_inputs(options.job);
  v1::CreateRegistrationJobRequest request = make_request(options.queue, options.job);
  client::RegistrationClient client(call_settings(options.server));
  upload_inputs(client, options.job, spec);
  *request.mutable_spec() = std::move(spec);
  const v1::RegistrationJob job = client.create(std::move(request));
  if (options.as_json)
    std::cout << job_json(job).dump(2) << std::endl;
  else
    std::cout << job.id() << std::endl;
  if (!has_output_arrived())
    throw FileError("standard output cannot be written; the job was made all the same, and its id is " + job.id());
  return Done;
}

}  // namespace

void add_submit_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("submit", "Send a job to a server and print its id");
  auto options = std::make_shared<SubmitOptions>();
  add_job_options(*command, options->job);
  add_queue_options(*command, options->queue);
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print the job as JSON");
  command->footer(
      "Example:\n"
      "  export SALTUS_SERVER=unix:/run/saltusd/socket\n"
      "  id=$(saltus submit --fixed a.nii.gz --moving b.nii.gz --label case=7)\n"
      "  saltus watch $id && saltus fetch $id --out result");
  command->callback([options, &exit_code] { exit_code = submit(*options); });
}

}  // namespace saltus::cli
