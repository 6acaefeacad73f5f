#include "core/support/available_cores.h"
#include "core/support/available_memory.h"
#include "core/support/errors.h"
#include "core/support/thread_binding.h"
#include "server/worker/attempt_process.h"
#include "server/worker/connection.h"
#include "server/worker/process_limits.h"
#include "server/worker/signals.h"
#include "server/worker/standing_worker.h"
#include "server/worker/worker_session.h"

#include <CLI/CLI.hpp>

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>

namespace {

using namespace saltus::worker;

constexpr double kGibibyte = 1 << 30;

struct Arguments {
  Connection connection;
  std::string blobs, uploads, job, token_file;
  int attempt = 0;
  bool guard = false;
  // Of a worker that comes by itself:
  int threads = 0;
  double memory_gib = 0, idle_seconds = 0;
  std::int64_t memory_bytes = 0;
};

/// A file, because argument lists and environments are open to every user of the machine.
std::string read_token(const std::string& file) {
  std::string token;
  if (file == "-")
    std::cin >> token;
  else
    std::ifstream(file) >> token;
  if (token.empty()) throw saltus::InvalidInput("--token-file is " + file + ", which holds no token or cannot be read");
  return token;
}

/// Looks after the process of the attempt, and cleans up after it.
int guard(const Arguments& arguments) {
  const Signals signals;
  AttemptOrder order{arguments.job, arguments.attempt, "", arguments.token_file, arguments.connection.options()};
  if (!arguments.blobs.empty()) order.options.insert(order.options.end(), {"--blobs", arguments.blobs});
  if (!arguments.uploads.empty()) order.options.insert(order.options.end(), {"--uploads", arguments.uploads});
  if (order.token_file == "-") {
    order.token = read_token("-");
    order.token_file.clear();
  }
  end_like(run_attempt_process(order, signals.stop()));
}

/// Takes jobs, one after the other.
int stand(const Arguments& arguments) {
  const Signals signals;
  StandingOptions options;
  options.connection = arguments.connection;
  options.blobs = arguments.blobs;
  options.threads = arguments.threads > 0 ? arguments.threads : saltus::available_cores();
  options.memory_bytes = static_cast<std::int64_t>(arguments.memory_gib * kGibibyte);
  if (arguments.memory_bytes > 0) options.memory_bytes = arguments.memory_bytes;
  if (options.memory_bytes == 0) options.memory_bytes = saltus::available_memory() / 10 * 8;
  options.idle = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * arguments.idle_seconds));
  char host[64] = "";
  ::gethostname(host, sizeof host - 1);
  options.name = std::string(host) + ":" + std::to_string(::getpid());
  return stand_by(options, signals.stop());
}

int run(const Arguments& arguments) {
  const bool has_attempt = !arguments.job.empty() || arguments.attempt > 0 || !arguments.token_file.empty();
  if (!has_attempt && !arguments.guard) return stand(arguments);
  if (arguments.job.empty() || arguments.attempt == 0 || arguments.token_file.empty())
    throw saltus::InvalidInput("--job, --attempt and --token-file belong together; give all, or none to take jobs");
  if (arguments.guard) return guard(arguments);
  const AttemptIdentity identity{arguments.connection.server,
                                 arguments.connection.identity(),
                                 arguments.job,
                                 arguments.attempt,
                                 read_token(arguments.token_file),
                                 arguments.blobs,
                                 arguments.uploads};
  catch_termination_signals();
  prepare_process();
  const int code = run_attempt(identity);
  // Without what libraries do when a process ends: where it could not write a file, HDF5 ends in a signal there, which
  // would be taken for the outcome.
  std::cerr.flush();
  std::fflush(nullptr);
  ::_exit(code);
}

}  // namespace

int main(int argument_count, char** words) {
  CLI::App app{
      "Runs one attempt of a job of saltusd, which starts this program; or, without --job, asks saltusd for jobs and "
      "runs one after the other, each in a process of its own",
      "saltus-worker"};
  app.set_version_flag("--version", "saltus-worker " SALTUS_VERSION);
  Arguments arguments;
  add_options(app, arguments.connection);
  app.add_option("--blobs", arguments.blobs,
                 "The daemon's folder blobs/sha256, when this machine sees it: inputs are read there")
      ->type_name("DIR");
  app.add_option("--uploads", arguments.uploads,
                 "The daemon's folder uploads, with --job on the daemon's own machine: results are put there")
      ->type_name("DIR");
  app.add_option("--job", arguments.job, "Id of the job");
  app.add_option("--attempt", arguments.attempt, "Number of the attempt")->check(CLI::PositiveNumber);
  app.add_option("--token-file", arguments.token_file,
                 "File with the launch token of the attempt; - is standard input, with --guard");
  app.add_option("--threads", arguments.threads, "Without --job: threads for one job [cores]")
      ->check(CLI::Range(1, 65536));
  app.add_option("--memory", arguments.memory_gib, "Without --job: GiB for one job [80 % of what there is]")
      ->check(CLI::Range(0.001, 1048576.0));
  app.add_option("--memory-bytes", arguments.memory_bytes, "The same in bytes")->group("");
  app.add_option("--idle-seconds", arguments.idle_seconds, "Without --job: end after so long without one; 0 never does")
      ->check(CLI::Range(0.0, 1e7))
      ->capture_default_str();
  app.add_flag("--guard", arguments.guard,
               "Run the attempt in a process below this one, with a folder for temporary files that goes with it");
  app.footer(
      "Exit codes: 0 an outcome was reported, 1 internal error, 2 usage, 3 saltusd not reachable for the length of "
      "the\n"
      "lease, 4 lease lost, 5 ended by SIGTERM before an outcome, 6 out of memory, which could not be reported, 7 no "
      "room for the results.");
  try {
    app.parse(argument_count, words);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? OutcomeReported : UsageError;
  }
  try {
    saltus::release_thread();
    return run(arguments);
  } catch (const saltus::InvalidInput& error) {
    std::cerr << "saltus-worker: " << error.what() << std::endl;
    return UsageError;
  } catch (const std::exception& error) {
    std::cerr << "saltus-worker: " << error.what() << std::endl;
    return InternalError;
  }
}
