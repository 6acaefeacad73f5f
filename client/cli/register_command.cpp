#include "client/cli/register_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/input_check.h"
#include "client/cli/job_options.h"
#include "client/cli/job_output.h"
#include "client/cli/progress_display.h"
#include "client/cli/register_pairs.h"
#include "client/cli/registrar.h"
#include "client/cli/report_summary.h"
#include "client/cli/run_job.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <iostream>
#include <memory>
#include <optional>

namespace saltus::cli {
namespace {

struct RegisterOptions {
  JobOptions job;
  std::string pairs;  ///< a list of pairs in place of one
  std::string out;
  int jobs = 0;                ///< of a list, as in PairsRequest
  bool is_jobs_typed = false;  ///< on the command line; what stands in the environment or a file is for lists alone
  ServerChoice server;
  bool as_json = false;
};

int register_one(const RegisterOptions& options) {
  const v1::RegistrationSpec spec = make_spec(options.job);
  check_inputs(options.job);
  refuse_inputs_among_results(options.job, options.out);
  const ResultFolder folder(options.out);
  std::optional<Registrar> registrar;
  try {
    registrar.emplace(options.server,
                      PrivateDaemon::Work{.jobs = 1, .threads = options.job.threads, .is_one_pair = true});
    v1::RegistrationJob job;
    {
      ProgressDisplay display(std::cerr, display_style_of_stderr());
      job = registrar->run(options.job, spec, options.out,
                           [&display](const v1::RegistrationJob& now) { display.show(now); });
    }
    if (const int code = exit_code_of(job); code != Done) return code;
    const nlohmann::json report = read_report(std::filesystem::path(options.out) / "report.json");
    if (options.as_json)
      std::cout << nlohmann::json{{"job", job_json(job)}, {"report", report}}.dump(2) << std::endl;
    else
      std::cout << report_summary(report) << "written to " << options.out << "; look at "
                << (std::filesystem::path(options.out) / "report.html").string() << std::endl;
    return Done;
  } catch (const client::ClientError& error) {
    if (!registrar || !registrar->is_interrupted() || error.code() != grpc::StatusCode::CANCELLED) throw;
    std::cerr << "saltus: interrupted" << std::endl;
    return Cancelled;
  }
}

int register_images(const RegisterOptions& options) {
  if (wants_parameter_help(options.job)) {
    std::cout << parameter_table(options.job);
    return Done;
  }
  if (options.pairs.empty()) {
    if (options.is_jobs_typed && options.jobs > 1)
      throw InvalidInput("--jobs is given without --pairs; one pair is one job");
    make_spec(options.job);  // what is wrong with the job itself is said first
    if (options.out.empty()) throw InvalidInput("--out is missing; name a folder for the result");
    return register_one(options);
  }
  if (options.out.empty()) throw InvalidInput("--out is missing; name a folder for the results");
  return register_pairs(
      {options.job, options.server, options.pairs, options.out, options.as_json, options.jobs, PairsOutput::Summary});
}

}  // namespace

void add_register_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("register", "Register two images and write the result to a folder");
  auto options = std::make_shared<RegisterOptions>();
  add_job_options(*command, options->job);
  command
      ->add_option("--pairs", options->pairs,
                   "List of pairs in place of --fixed and --moving: columns fixed, moving and, if you like, name,\n"
                   "fixed_mask, moving_mask, fixed_points, moving_points; run again, it goes on where it ended")
      ->type_name("CSV")
      ->check(CLI::ExistingFile);
  const CLI::Option* const jobs = add_jobs_option(*command, options->jobs);
  command
      ->add_option("--out", options->out,
                   "Folder for the result, made if need be (required); with --pairs one below it for each pair")
      ->type_name("DIR");
  // SALTUS_SERVER is for the commands that need a server; here none means a private one.
  command
      ->add_option("--server", options->server.address,
                   "Address of saltusd, unix:/path or host:port; without it a private one is started and stopped")
      ->type_name("ADDRESS");
  add_tls_options(*command, options->server);
  command->add_flag("--json", options->as_json, "Print job and report as JSON");
  command->footer(
      "DIR holds displacement, inverse_displacement, warped, jacobian, the momenta, transform.h5, interface.csv and\n"
      "interface.vtp (where it slides: points, normals, area, tangential jump, gap), report.json, report.html.\n"
      "Ctrl-C cancels the job. Exit codes: 0 done, 1 failed, 2 usage, 3 server not reachable, 4 cancelled.\n"
      "Examples:\n"
      "  saltus register --fixed exhale.nii.gz --moving inhale.nii.gz --out result\n"
      "  saltus register --fixed ct1.mha --moving ct2.mha --affine rigid --intensity-window -1000,400 \\\n"
      "      --fixed-mask body.mha --preset accurate --out result\n"
      "  saltus register --pairs patients.csv --out results    # a list, with fixed,moving in its first line\n"
      "  saltus register --fixed a.mha --moving b.mha --fixed-points a.csv --moving-points b.csv \\\n"
      "      --points-space ras --out result\n"
      "  saltus register --model wendland1 --set help");
  command->callback([options, command, jobs, &exit_code] {
    // The parser enters here what it has read from the command line, and nothing else.
    const std::vector<CLI::Option*>& typed = command->parse_order();
    options->is_jobs_typed = std::find(typed.begin(), typed.end(), jobs) != typed.end();
    exit_code = register_images(*options);
  });
}

}  // namespace saltus::cli
