#include "server/worker/process_limits.h"
#include "server/worker/worker_session.h"

#include <CLI/CLI.hpp>

#include <cstdlib>
#include <fstream>
#include <iostream>

int main(int argument_count, char** arguments) {
  using namespace saltus::worker;
  CLI::App app{"Runs one attempt of a job of saltusd, which starts this program", "saltus-worker"};
  app.set_version_flag("--version", "saltus-worker " SALTUS_VERSION);
  AttemptIdentity identity;
  std::string token_file;
  app.add_option("--server", identity.server, "Address of saltusd: unix:/path or host:port")->required();
  app.add_option("--job", identity.job_id, "Id of the job")->required();
  app.add_option("--attempt", identity.attempt, "Number of the attempt")->required()->check(CLI::PositiveNumber);
  app.add_option("--token-file", token_file, "File with the launch token of the attempt")
      ->required()
      ->check(CLI::ExistingFile);
  app.footer(
      "Exit codes: 0 an outcome was reported, 1 internal error, 2 usage, 3 saltusd not reachable for the length of "
      "the\n"
      "lease, 4 lease lost, 5 ended by SIGTERM before an outcome, 6 out of memory, which could not be reported, 7 no "
      "room for the results.");
  try {
    app.parse(argument_count, arguments);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? OutcomeReported : UsageError;
  }
  // A file, because argument lists and environments are open to every user of the machine.
  std::ifstream(token_file) >> identity.token;
  if (identity.token.empty()) {
    std::cerr << "saltus-worker: --token-file is " << token_file << ", which holds no token" << std::endl;
    return UsageError;
  }
  catch_termination_signals();
  prepare_process();
  return run_attempt(identity);
}
