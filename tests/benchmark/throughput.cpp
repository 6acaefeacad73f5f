#include "tests/benchmark/throughput.h"

#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <fstream>
#include <ostream>
#include <stdexcept>
#include <thread>

#include "core/support/available_cores.h"
#include "tests/benchmark/measured_process.h"

extern char** environ;

namespace saltus::benchmark {
namespace {

namespace fs = std::filesystem;

struct Setting {
  int jobs, threads;
  std::string text() const { return std::to_string(jobs) + "x" + std::to_string(threads); }
};

Setting parse(const std::string& text) {
  Setting setting{0, 0};
  const char* end = text.data() + text.size();
  const auto jobs = std::from_chars(text.data(), end, setting.jobs);
  if (jobs.ptr != end && *jobs.ptr == 'x') {
    const auto threads = std::from_chars(jobs.ptr + 1, end, setting.threads);
    if (threads.ptr == end && setting.jobs > 0 && setting.threads > 0) return setting;
  }
  throw std::runtime_error("'" + text + "' is no setting; it must be jobs and threads, as 2x1");
}

/// What divides the cores without a rest, then one job a core with as many threads as there are cores.
std::vector<Setting> all_settings() {
  std::vector<Setting> settings;
  for (int threads = 1; threads <= available_cores(); ++threads)
    if (available_cores() % threads == 0) settings.push_back({available_cores() / threads, threads});
  if (available_cores() > 1) settings.push_back({available_cores(), available_cores()});
  return settings;
}

void require_done(const ProcessCost& cost, const fs::path& log, const std::string& what) {
  if (cost.exit_code != 0)
    throw std::runtime_error(what + " ended with " + std::to_string(cost.exit_code) + ", see " + log.string());
}

/// Seconds in which the cores were not idle, since the machine has started.
double busy_seconds() {
  std::ifstream file("/proc/stat");
  std::string word;
  file >> word;
  double busy = 0, value = 0;
  for (int column = 0; column < 8 && file >> value; ++column)
    if (column != 3 && column != 4) busy += value;
  return busy / static_cast<double>(sysconf(_SC_CLK_TCK));
}

/// A saltusd on a socket of its own; stop() gives what it and all its workers have used.
class Daemon {
 public:
  Daemon(const fs::path& program, const fs::path& folder, const Setting& setting) {
    fs::remove_all(folder);
    fs::create_directories(folder);
    address_ = "unix:" + (folder / "socket").string();
    std::vector<std::string> words{program,
                                   "--data",
                                   folder / "data",
                                   "--listen",
                                   address_,
                                   "--log-level",
                                   "warning",
                                   "--disk-reserve",
                                   "64M",
                                   "--slots",
                                   std::to_string(setting.jobs),
                                   "--threads-per-job",
                                   std::to_string(setting.threads),
                                   "--threads",
                                   std::to_string(setting.jobs * setting.threads)};
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    int ends[2];
    if (pipe(ends) != 0) throw std::runtime_error("no pipe can be made");
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_addclose(&files, ends[0]);
    const int error = posix_spawn(&process_, program.c_str(), &files, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    close(ends[1]);
    char said[4096];
    const bool is_listening = error == 0 && read(ends[0], said, sizeof said) > 0;
    close(ends[0]);
    if (!is_listening) throw std::runtime_error(program.string() + " does not serve " + address_);
  }
  ~Daemon() {
    if (process_ > 0) stop();
  }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  const std::string& address() const { return address_; }
  double stop() {
    kill(process_, SIGTERM);
    rusage use{};
    int status = 0;
    while (wait4(process_, &status, 0, &use) < 0 && errno == EINTR) {
    }
    process_ = -1;
    const auto seconds = [](const timeval& time) {
      return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    };
    return seconds(use.ru_utime) + seconds(use.ru_stime);
  }

 private:
  pid_t process_ = -1;
  std::string address_;
};

std::string first_line(const fs::path& file) {
  std::string line;
  std::getline(std::ifstream(file) >> std::ws, line);
  return line;
}

Row run(const ThroughputOptions& options, const fs::path& pair, const Setting& setting) {
  const fs::path folder = fs::absolute(options.out) / setting.text();
  Daemon daemon(options.programs / "saltusd", folder, setting);
  const fs::path saltus = options.programs / "saltus", log = folder / "log";
  const auto begin = std::chrono::steady_clock::now();
  const double busy_before = busy_seconds();
  double cpu = 0;
  const auto call = [&](std::vector<std::string> words) {
    words.insert(words.end(), {"--server", daemon.address()});
    const ProcessCost cost = run_measured(words, {}, log);
    require_done(cost, log, "saltus " + words[1] + " with " + setting.text());
    cpu += cost.cpu_seconds;
  };
  std::vector<std::string> jobs;
  for (int i = 0; i < options.pairs; ++i) {
    call({saltus, "submit", "--fixed", pair / "fixed.mha", "--moving", pair / "moving.mha"});
    jobs.push_back(first_line(log));
  }
  for (const std::string& job : jobs) call({saltus, "watch", job});
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const double busy = busy_seconds() - busy_before;
  cpu += daemon.stop();
  Row row;
  row.name = std::to_string(setting.jobs) + (setting.jobs == 1 ? " job" : " jobs") + " of " +
             std::to_string(setting.threads) + (setting.threads == 1 ? " thread" : " threads");
  row.outcome = "done";
  row.add("wall", wall);
  row.add("cpu_each", cpu / options.pairs);
  row.add("pairs_per_hour", 3600 * options.pairs / wall);
  row.add("cores_used", cpu / wall);
  row.add("others", std::max(0.0, busy - cpu) / wall);
  return row;
}

}  // namespace

std::vector<Row> throughput_rows(const ThroughputOptions& options, std::ostream& progress) {
  std::vector<Setting> settings;
  for (const std::string& text : options.settings) settings.push_back(parse(text));
  if (settings.empty()) settings = all_settings();
  const fs::path out = fs::absolute(options.out);
  fs::create_directories(out);
  const fs::path log = out / "phantom.log";
  const std::string across = std::to_string(options.size), along = std::to_string(options.size * 2 / 3);
  require_done(
      run_measured({options.programs / "saltus", "phantom", "thorax", "--size", across + "," + across + "," + along,
                    "--spacing", std::to_string(384.0 / options.size), "--out", out / "pair"},
                   {}, log),
      log, "saltus phantom");
  std::vector<Row> rows;
  for (const Setting& setting : settings) {
    progress << setting.text() << std::endl;
    rows.push_back(run(options, out / "pair", setting));
  }
  return rows;
}

std::vector<Column> throughput_columns() {
  return {{"wall", "wall s", 0},
          {"cpu_each", "CPU s a pair", 1},
          {"pairs_per_hour", "pairs an hour", 0},
          {"cores_used", "cores used", 2},
          {"others", "cores others used", 2}};
}

}  // namespace saltus::benchmark
