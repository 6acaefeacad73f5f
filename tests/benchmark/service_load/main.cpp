// saltus-load: a daemon under load, how long a call that needs nothing takes meanwhile, and how long a restart takes.
#include "tests/benchmark/service_load/idle_worker.h"
#include "tests/benchmark/service_load/load.h"
#include "tests/benchmark/service_load/many_workers.h"
#include "tests/benchmark/service_load/pinger.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <fstream>
#include <iostream>

int main(int argument_count, char** arguments) {
  using namespace saltus::benchmark;
  namespace fs = std::filesystem;
  CLI::App app("Loads a daemon of its own and measures it; exit code 1 when a target is missed", "saltus-load");
  const fs::path own = fs::read_symlink("/proc/self/exe");
  LoadOptions options;
  WorkerOptions attempt;
  options.daemon = own.parent_path() / "saltusd";
  options.self = own;
  WorkersOptions workers{.daemon = {}, .workers = 0};
  bool is_quick = false;
  std::string json_file, pinged;
  app.add_option("--daemon", options.daemon, "Path of saltusd [beside this program]")->type_name("FILE");
  app.add_option("--queued", options.queued, "Jobs in the queue")->check(CLI::Range(1, 10000))->capture_default_str();
  app.add_option("--watchers", options.watchers, "Watchers at the same time")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  app.add_option("--uploads", options.uploads, "Uploads at the same time")
      ->check(CLI::Range(0, 16))
      ->capture_default_str();
  app.add_option("--upload-mebibytes", options.upload_mebibytes, "Size of each")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--seconds", options.seconds, "How long to measure")
      ->check(CLI::Range(1, 86400))
      ->capture_default_str();
  app.add_option("--rows", options.rows, "Jobs in the database at the restart")->capture_default_str();
  app.add_option("--workers", workers.workers,
                 "Instead of all that: so many workers that come by themselves and take no time for a job")
      ->check(CLI::Range(1, 2000));
  app.add_option("--jobs", workers.jobs, "With --workers: jobs that they do")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  app.add_option("--artifact-kibibytes", workers.artifact_kibibytes, "With --workers: what a job makes")
      ->check(CLI::Range(1, 65536))
      ->capture_default_str();
  app.add_option("--heartbeats", workers.heartbeats_per_second, "With --workers: in a second, of all together")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--json", json_file, "Write all figures there")->type_name("FILE");
  app.add_flag("--quick", is_quick, "Small numbers and no targets: only whether it works");
  // How this program calls itself, and how the daemon calls it as its worker.
  app.add_option("--ping", pinged)->group("");
  app.add_option("--server", attempt.server)->group("");
  app.add_option("--job", attempt.job)->group("");
  app.add_option("--attempt", attempt.attempt)->group("");
  app.add_option("--token-file", attempt.token_file)->group("");
  CLI11_PARSE(app, argument_count, arguments);
  try {
    if (!attempt.job.empty()) {
      work_idly(attempt);
      return 0;
    }
    if (!pinged.empty()) {
      std::cout << to_text(ping(pinged, options.seconds));
      return 0;
    }
    if (is_quick) {
      options = {.daemon = options.daemon,
                 .self = own,
                 .queued = 50,
                 .watchers = 10,
                 .uploads = 2,
                 .upload_mebibytes = 1,
                 .seconds = 1,
                 .rows = 100,
                 .is_judged = false};
    }
    if (workers.workers > 0) {
      workers.daemon = options.daemon;
      workers.seconds = is_quick ? 1 : std::min(options.seconds, 20);
      if (is_quick) workers.jobs = 50;
      if (is_quick) workers.heartbeats_per_second = 100;
    }
    const std::vector<Figure> figures = workers.workers > 0 ? run_many_workers(workers) : run_load(options);
    print_figures(std::cout, figures);
    if (!json_file.empty()) {
      std::ofstream file(json_file);
      file << as_json(figures).dump(1) << '\n';
      file.close();
      if (!file) throw std::runtime_error(json_file + " could not be written");
    }
    return std::any_of(figures.begin(), figures.end(), [](const Figure& figure) { return figure.is_missed(); }) ? 1 : 0;
  } catch (const std::exception& error) {
    std::cerr << "saltus-load: " << error.what() << '\n';
    return 2;
  }
}
