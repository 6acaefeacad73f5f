#include "client/cli/command_line.h"

#include "client/cli/cancel_command.h"
#include "client/cli/closest_word.h"
#include "client/cli/command.h"
#include "client/cli/command_tree.h"
#include "client/cli/delete_command.h"
#include "client/cli/dirlab_command.h"
#include "client/cli/evaluate_command.h"
#include "client/cli/fetch_command.h"
#include "client/cli/get_command.h"
#include "client/cli/list_command.h"
#include "client/cli/manual_page.h"
#include "client/cli/output_errors.h"
#include "client/cli/phantom_command.h"
#include "client/cli/points_command.h"
#include "client/cli/register_command.h"
#include "client/cli/server_command.h"
#include "client/cli/shell_completion.h"
#include "client/cli/study_command.h"
#include "client/cli/submit_command.h"
#include "client/cli/warp_command.h"
#include "client/cli/watch_command.h"
#include "client/lib/client_error.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <cstdlib>
#include <filesystem>
#include <iostream>

namespace saltus::cli {
namespace {

int fail(ExitCode code, const std::string& message) {
  std::cerr << "saltus: " << message << std::endl;
  return code;
}

/// The exit code of a command that has done its work: what it had to tell must have arrived too.
int told_in_full(int exit_code) {
  if (has_output_arrived()) return exit_code;
  return fail(JobFailed,
              "standard output cannot be written, so what the command tells is lost; make room where it goes, or keep "
              "open what reads it");
}

ExitCode code_of_call(const client::ClientError& error) {
  switch (error.code()) {
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return ServerNotReachable;
    case grpc::StatusCode::CANCELLED:
      return Cancelled;
    case grpc::StatusCode::INVALID_ARGUMENT:
      return Usage;
    default:
      return JobFailed;
  }
}

/// The command whose options were being read.
const CLI::App& command_at_hand(const CLI::App& app) {
  const std::vector<CLI::App*> chosen = app.get_subcommands();
  return chosen.empty() ? app : command_at_hand(*chosen.back());
}

/// "saltus: what is wrong", and where there is more.
std::string failure_text(const CLI::App* app, const CLI::Error& error) {
  std::string name;
  for (const CLI::App* at = &command_at_hand(*app); at; at = at->get_parent()) name = at->get_name() + ' ' + name;
  return std::string("saltus: ") + error.what() + "\n" + name + "--help tells what there is.\n";
}

/// For each word that nobody expected: what may have been meant.
std::string suggestions(const CLI::App& app) {
  const CLI::App& command = command_at_hand(app);
  std::vector<std::string> options, commands;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) options.push_back("--" + name);
  for (const CLI::App* one : command.get_subcommands({})) commands.push_back(one->get_name());
  std::string text;
  for (const std::string& word : app.remaining(true)) {
    const std::string typed = word.substr(0, word.find('='));
    if (const std::string meant = closest_word(typed, typed.starts_with("--") ? options : commands); !meant.empty())
      text += "Did you mean " + meant + "?\n";
  }
  return text;
}

/// Options from a file and from the environment, for what the command line leaves open.
void use_settings(CLI::App& app, int argument_count, const char* const* arguments) {
  const char* const file = std::getenv("SALTUS_CONFIG");
  if (file && *file && !std::filesystem::exists(file))
    throw InvalidInput(std::string("SALTUS_CONFIG is ") + file + ", which is not there");
  app.set_config("--config", file ? file : "",
                 "File with a section for each command and its options, such as\n"
                 "[register] and model = \"gaussian\"; $SALTUS_CONFIG stands in for it")
      ->type_name("FILE");
  app.allow_config_extras(CLI::config_extras_mode::error);
  for (CLI::App* command : app.get_subcommands({})) command->fallthrough();
  take_options_from_environment(app, argument_count, arguments);
}

}  // namespace

int run_command_line(int argument_count, const char* const* arguments) {
  int exit_code = Done;
  CLI::App app{"Image registration for motion that slides", "saltus"};
  app.set_version_flag("--version", "saltus " SALTUS_VERSION);
  app.require_subcommand(1);
  app.failure_message(failure_text);
  add_register_command(app, exit_code);
  add_submit_command(app, exit_code);
  add_watch_command(app, exit_code);
  add_list_command(app, exit_code);
  add_get_command(app, exit_code);
  add_fetch_command(app, exit_code);
  add_cancel_command(app, exit_code);
  add_delete_command(app, exit_code);
  add_points_command(app, exit_code);
  add_warp_command(app, exit_code);
  add_evaluate_command(app, exit_code);
  add_phantom_command(app, exit_code);
  add_dirlab_command(app, exit_code);
  add_study_command(app, exit_code);
  add_server_command(app, exit_code);
  add_completion_command(app, exit_code);
  add_manual_command(app, exit_code);
  app.footer(
      "Options can also stand in a file (--config) and in the environment (SALTUS_MODEL for --model).\n"
      "Exit codes: 0 done, 1 failed, 2 usage, 3 server not reachable, 4 cancelled.\n"
      "Examples:\n"
      "  saltus register --fixed exhale.nii.gz --moving inhale.nii.gz --out result    # then open result/report.html\n"
      "  saltus phantom slip --angle 30 --out scene\n"
      "  saltus register --fixed scene/fixed.mha --moving scene/moving.mha --out result\n"
      "  saltus evaluate --transform result --truth scene/truth.mha --mask scene/mask_valid.mha");
  try {
    use_settings(app, argument_count, arguments);
    app.parse(argument_count, arguments);
    return told_in_full(exit_code);
  } catch (const CLI::ExtrasError& error) {
    app.exit(error);
    std::cerr << suggestions(app)
              << "What a command works on is named by options, such as --fixed A --moving B --out DIR." << std::endl;
    return Usage;
  } catch (const CLI::ParseError& error) {
    if (app.exit(error) == 0) return told_in_full(Done);  // help was asked for
    std::cerr << suggestions(app) << std::flush;
    return Usage;
  } catch (const InvalidInput& error) {
    return fail(Usage, error.what());
  } catch (const client::ClientError& error) {
    return fail(code_of_call(error), error.what());
  } catch (const std::exception& error) {
    return fail(JobFailed, error.what());
  }
}

}  // namespace saltus::cli
