#include "server/config/config.h"

#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <unistd.h>

#include <algorithm>
#include <thread>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

constexpr int kUsage = 2;

fs::path default_worker() { return fs::read_symlink("/proc/self/exe").parent_path() / "saltus-worker"; }

void require_program(const fs::path& program) {
  if (::access(program.c_str(), X_OK) != 0 || fs::is_directory(program))
    throw InvalidInput("--worker is " + program.string() + ", which is not a program; give the path of saltus-worker");
}

}  // namespace

ParsedConfig parse_config(int argc, char** argv) {
  CLI::App app("The saltus daemon: accepts registration jobs, keeps them safely and hands them to workers.", "saltusd");
  ParsedConfig parsed;
  Config& config = parsed.config;
  std::string data, listen, worker;
  double lease_seconds = 30;
  config.log_level = "info";
  app.set_version_flag("--version", SALTUS_VERSION);
  app.add_option("--data", data, "Folder for jobs, images and results; made when missing")
      ->required()
      ->type_name("DIR");
  app.add_option("--listen", listen, "unix:/path or 127.0.0.1:port; port 0 takes a free one [unix:DIR/saltusd.sock]")
      ->type_name("ADDRESS");
  app.add_option("--slots", config.slots, "Workers at the same time [cores / threads per job]")
      ->check(CLI::Range(1, 1024));
  app.add_option("--threads-per-job", config.threads_per_job, "Threads of a job that does not say [cores]")
      ->check(CLI::Range(1, 1024));
  app.add_option("--worker", worker, "The worker's program [saltus-worker beside saltusd]")->type_name("PATH");
  app.add_option("--lease-seconds", lease_seconds, "How long a worker may be silent before its job is given to another")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str();
  app.add_option("--log-level", config.log_level, "trace, debug, info, warning, error or off")
      ->check(CLI::IsMember({"trace", "debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  app.add_flag("--exit-on-stdin-close", config.exit_on_stdin_close,
               "Stop when standard input ends: a private daemon goes with its client");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    parsed.has_ended = true;
    parsed.exit_code = app.exit(error) == 0 ? 0 : kUsage;
    return parsed;
  }
  config.data = fs::absolute(data).lexically_normal();
  config.listen = parse_listen_address(listen.empty() ? "unix:" + (config.data / "saltusd.sock").string() : listen);
  const int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  if (config.threads_per_job == 0) config.threads_per_job = cores;
  if (config.slots == 0) config.slots = std::max(1, cores / config.threads_per_job);
  config.worker = worker.empty() ? default_worker() : fs::absolute(worker);
  require_program(config.worker);
  config.lease = std::chrono::milliseconds(static_cast<long long>(lease_seconds * 1000));
  return parsed;
}

}  // namespace saltus::server
