#include "client/cli/study_command.h"

#include "client/cli/study/liver_study.h"
#include "client/cli/study/paper_study.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <memory>

namespace saltus::cli {
namespace {

struct StudyOptions {
  StudyRequest request;
  std::string out, data;
  bool as_json = false;
};

void add_common_options(CLI::App& command, StudyOptions& options, const std::string& data_meaning) {
  command.add_option("--out", options.out, "Folder for runs, figures and tables; run again, it goes on")
      ->type_name("DIR")
      ->required();
  command.add_option("--data", options.data, data_meaning)->type_name("DIR")->check(CLI::ExistingDirectory);
  command.add_flag("--quick", options.request.is_quick,
                   "Small scenes or one pair: to see in a minute that all is well");
  command.add_option("--threads", options.request.threads, "Threads of each run; CPU seconds mean most with one")
      ->type_name("N")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  add_jobs_option(command, options.request.jobs);
  command.add_option("--server", options.request.server.address, "Address of saltusd; without it a private one")
      ->type_name("ADDRESS");
  add_tls_options(command, options.request.server);
  command.add_flag("--json", options.as_json, "Print the tables as JSON");
}

StudyRequest request_of(const StudyOptions& options) {
  StudyRequest request = options.request;
  request.out = options.out;
  request.data = options.data;
  return request;
}

}  // namespace

void add_study_command(CLI::App& app, int& exit_code) {
  CLI::App* study = app.add_subcommand("study", "The paper's figures, and models and presets on liver images");
  study->require_subcommand(1);

  CLI::App* paper = study->add_subcommand("paper", "The paper's figures with a table of errors, from one command");
  auto paper_options = std::make_shared<StudyOptions>();
  add_common_options(*paper, *paper_options,
                     "Folder with paper2d (the paper's own images) and liver_mri (for the lung figures)");
  paper->footer(
      "Written: figures/*.png, study.html (all of it in one page), study.md, study.json; runs and scenes beside them.\n"
      "Examples:\n"
      "  saltus study paper --out paper\n"
      "  saltus study paper --data data --out paper\n"
      "  saltus study paper --quick --out paper");
  paper->callback(
      [paper_options, &exit_code] { exit_code = paper_study(request_of(*paper_options), paper_options->as_json); });

  CLI::App* liver = study->add_subcommand("liver", "Models and presets on four liver pairs with landmarks");
  auto liver_options = std::make_shared<StudyOptions>();
  add_common_options(*liver, *liver_options, "Folder with liver_mri (required)");
  liver->get_option("--data")->required();
  liver_options->request.models = comparable_models();
  liver_options->request.presets = {"fast", "balanced"};
  liver->add_option("--models", liver_options->request.models, "Compared with each other")
      ->delimiter(',')
      ->capture_default_str();
  liver
      ->add_option("--presets", liver_options->request.presets,
                   "Each of them with each model; the figures show the last")
      ->delimiter(',')
      ->capture_default_str();
  liver->footer(
      "Written: as by study paper.\n"
      "Examples:\n"
      "  saltus study liver --data data --out liver\n"
      "  saltus study liver --data data --models sliding --presets fast,balanced,accurate --out liver");
  liver->callback(
      [liver_options, &exit_code] { exit_code = liver_study(request_of(*liver_options), liver_options->as_json); });
}

}  // namespace saltus::cli
