// Kills daemon and workers at named places and at random, under random traffic, and checks after each restart that
// everything that was acknowledged is kept. Exit code 0 when it is.
#include "core/image_io/write_image.h"
#include "tests/crash/power_cut.h"
#include "tests/crash/traffic.h"
#include "tests/support/blob_pair.h"
#include "tests/support/child_process.h"

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>
#include <sstream>
#include <thread>

namespace saltus::crash {
namespace {

namespace fs = std::filesystem;
using testing_support::ChildProcess;

constexpr int clients = 3;
constexpr int fewest_actions = 5, most_actions = 25;  ///< of each client in a cycle

/// Named places, and how often they are passed in a cycle, about.
struct Place {
  const char* name;
  int passes;
};
constexpr Place places[] = {
    {"sync.before", 8},
    {"sync.after", 8},
    {"rename.before", 4},
    {"rename.after", 4},
    {"remove.before", 2},
    {"remove.after", 2},
    {"commit.before", 10},
    {"commit.after", 10},
    {"acknowledge.after", 12},
    {"launch.before", 2},
    {"launch.after", 2},
    {"reap.before", 2},
    {"worker.acquired", 1},
    {"worker.checkpoint.before", 2},
    {"worker.checkpoint.after", 2},
    {"worker.upload.before", 2},
    {"worker.upload.after", 2},
    {"worker.complete.before", 1},
    {"worker.complete.after", 1},
};

std::string content_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

std::vector<pid_t> children_of(pid_t process) {
  std::vector<pid_t> found;
  std::error_code gone;
  for (const auto& thread : fs::directory_iterator("/proc/" + std::to_string(process) + "/task", gone)) {
    std::ifstream in(thread.path() / "children");
    for (pid_t child; in >> child;) found.push_back(child);
  }
  return found;
}

class Harness {
 public:
  Harness(fs::path programs, unsigned seed) : programs_(std::move(programs)), generator_(seed) {
    std::string name = fs::temp_directory_path() / "saltus_crash_XXXXXX";
    if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder can be made");
    folder_ = name;
    record_ = folder_ / "record";
    // Workers whose daemon was killed become children of this process, which ends them.
    prctl(PR_SET_CHILD_SUBREAPER, 1);
    make_clients(seed);
  }
  ~Harness() {
    daemon_.reset();
    end_orphans();
  }

  void run(int cycles) {
    for (cycle_ = 1; cycle_ <= cycles; ++cycle_) run_cycle();
    come_to_rest();
    fs::remove_all(folder_);
  }
  std::string where() const {
    return "cycle " + std::to_string(cycle_) + " (" + plan_ + "), data in " + folder_.string();
  }
  void summarise(std::ostream& out) const {
    std::size_t jobs = 0, ended = 0, deleted = 0, uploads = 0, cut_uploads = 0;
    std::map<std::string, int> ends;
    for (const Traffic& client : clients_) {
      uploads += client.model.uploads.size();
      cut_uploads += client.model.pending.size();
      for (const KnownJob& job : client.model.jobs) {
        ++jobs;
        deleted += job.is_deleted;
        ended += job.end.has_value();
        if (job.end) ++ends[job.end->substr(0, job.end->find(' '))];
      }
    }
    out << jobs << " jobs (" << deleted << " deleted, " << ended << " seen to end), " << uploads << " uploads, "
        << cut_uploads << " more uploads cut and not yet continued.\n";
    out << deaths_ << " deaths of the daemon at a named place, " << kills_ << " at random, " << worker_kills_
        << " workers killed at random; " << cuts_ << " power cuts, which took the ends of " << losses_.files
        << " files and " << losses_.names << " names; " << checks_ << " checks of all blobs.\nEnds:";
    for (const auto& [state, count] : ends) out << ' ' << count << ' ' << state;
    out << "\nDeaths:";
    for (const auto& [place, count] : deaths_at_) out << ' ' << place << ' ' << count;
    out << '\n';
  }

 private:
  int random_below(int count) { return std::uniform_int_distribution<int>(0, count - 1)(generator_); }

  void start(const std::map<std::string, std::string>& environment) {
    const std::string socket = (folder_ / "socket").string();
    std::map<std::string, std::string> variables{{"OMP_NUM_THREADS", "1"}, {"SALTUS_DISK_RECORD", record_.string()}};
    variables.insert(environment.begin(), environment.end());
    daemon_.emplace(std::vector<std::string>{programs_ / "saltusd-failpoints", "--data", folder_ / "data", "--listen",
                                             "unix:" + socket, "--worker", programs_ / "saltus-fake-worker", "--slots",
                                             "4", "--threads-per-job", "1", "--lease-seconds", "3",
                                             "--checkpoint-seconds", "0.001", "--retry-seconds", "0.05",
                                             // Nobody reads what it prints meanwhile.
                                             "--log-level", "warning"},
                    variables);
    daemon_->wait_for_output("listening on");
    address_ = "unix:" + socket;
  }

  /// The daemon's promises after a restart. False when it has gone meanwhile.
  bool check() {
    try {
      Connection daemon(address_);
      for (Traffic& client : clients_) client.model.resolve(daemon);
      const auto listed = daemon.list_all();
      for (Traffic& client : clients_) client.model.compare(daemon, listed);
      return true;
    } catch (const DaemonGone&) {
      return false;
    }
  }

  void make_clients(unsigned seed) {
    plan_ = "start";
    start({});
    Connection daemon(address_);
    v1::RegistrationSpec real;
    const auto upload = [&](const std::string& name, double shift) {
      const fs::path file = folder_ / (name + ".mha");
      write_volume(file, testing_support::blob_scene(20, shift));
      return daemon.upload(content_of(file));
    };
    real.mutable_fixed()->set_digest(upload("fixed", 0));
    real.mutable_fixed()->set_format("mha");
    real.mutable_moving()->set_digest(upload("moving", 2));
    real.mutable_moving()->set_format("mha");
    real.set_model("gaussian");
    real.set_similarity("ssd");
    real.set_preset("fast");
    real.set_output_format("mha");
    (*real.mutable_settings())["max_iterations"] = "8";
    (*real.mutable_settings())["tolerance"] = "0";
    for (int i = 0; i < clients; ++i)
      clients_.emplace_back("client" + std::to_string(i), seed * 1000 + static_cast<unsigned>(i), real);
    // One that nobody disturbs, to compare the others with.
    Model& model = clients_.front().model;
    KnownJob& job = model.add(real);
    v1::RegistrationJob said;
    daemon.create(job.request, said);
    model.observe(job, said);
    daemon.watch_to_the_end(said.id(), [&](const v1::RegistrationJob& now) { model.observe(job, now); });
    if (Model::reference.empty()) throw Violation("a registration that nobody disturbed did not succeed");
    kill_daemon();
  }

  void kill_daemon() {
    daemon_->signal(SIGKILL);
    daemon_->wait();
    daemon_.reset();
  }

  void run_cycle() {
    std::map<std::string, std::string> environment;
    const fs::path armed = folder_ / "armed";
    fs::remove(armed);
    const bool is_named = random_below(100) < 75;
    const bool from_the_start = random_below(100) < 15;
    const bool kills_workers = random_below(100) < 30;
    cuts_power_ = random_below(100) < 25;
    checks_blobs_ = random_below(100) < 5;
    place_.clear();
    plan_ = "killed at random";
    if (is_named) {
      const Place& place = places[random_below(static_cast<int>(std::size(places)))];
      const std::string point = std::string(place.name) + ":" + std::to_string(1 + random_below(place.passes));
      environment = {{"SALTUS_FAILPOINT", point}, {"SALTUS_FAILPOINT_ARMED", armed.string()}};
      place_ = place.name;
      plan_ = point + (from_the_start ? " from the start" : "");
    }
    if (from_the_start) std::ofstream(armed) << "yes";
    try {
      start(environment);
    } catch (const std::runtime_error&) {
      // It came to its place before it could listen; then, and only then, its end by force is no fault.
      if (!from_the_start || daemon_->wait() != 128 + SIGKILL) throw;
      count_death();
      daemon_.reset();
      if (cuts_power_) cut_power_here();
      return;
    }
    if (check()) {
      std::ofstream(armed) << "yes";
      traffic(kills_workers);
    } else if (!from_the_start) {
      throw Violation("the daemon ended by itself: " + daemon_->err());
    }
    const bool has_died = testing_support::ProcessHandle(daemon_->id()).ends_within(std::chrono::milliseconds(0));
    if (has_died)
      count_death();
    else
      ++kills_;
    daemon_->signal(SIGKILL);
    if (const int code = daemon_->wait(); code != 128 + SIGKILL)
      throw Violation("the daemon ended by itself with code " + std::to_string(code) + ": " + daemon_->err());
    daemon_.reset();
    if (cuts_power_)
      cut_power_here();
    else if (random_below(4) == 0)
      end_orphans();
  }

  void count_death() {
    ++deaths_;
    ++deaths_at_[place_];
  }

  /// All processes end, and what is not on the disk is gone.
  void cut_power_here() {
    end_orphans();
    const Losses losses = cut_power(record_);
    ++cuts_;
    losses_.files += losses.files;
    losses_.names += losses.names;
    plan_ += ", then the power was cut";
  }

  void traffic(bool kills_workers) {
    std::vector<std::exception_ptr> errors(clients_.size());
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < clients_.size(); ++i) {
      const int actions = fewest_actions + random_below(most_actions - fewest_actions);
      threads.emplace_back([&, i, actions] {
        try {
          clients_[i].run(address_, actions);
        } catch (...) {
          errors[i] = std::current_exception();
        }
      });
    }
    std::exception_ptr check_error;
    if (checks_blobs_) {
      ++checks_;
      threads.emplace_back([&] {
        try {
          Connection(address_).check_blobs();
        } catch (const DaemonGone&) {
          // It was killed meanwhile.
        } catch (...) {
          check_error = std::current_exception();
        }
      });
    }
    if (kills_workers) {
      const auto workers = children_of(daemon_->id());
      if (!workers.empty()) {
        ::kill(workers[static_cast<std::size_t>(random_below(static_cast<int>(workers.size())))], SIGKILL);
        ++worker_kills_;
      }
    }
    threads.clear();
    errors.push_back(check_error);
    for (const auto& error : errors)
      if (error) std::rethrow_exception(error);
  }

  /// Ends the workers that a killed daemon has left.
  static void end_orphans() {
    for (const pid_t child : children_of(getpid())) {
      ::kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    }
  }

  /// Nobody disturbs any more: every job must come to an end, and stay there.
  void come_to_rest() {
    plan_ = "coming to rest";
    try {
      rest();
    } catch (const DaemonGone& error) {
      const bool is_there = !testing_support::ProcessHandle(daemon_->id()).ends_within(std::chrono::milliseconds(0));
      if (is_there) daemon_->signal(SIGKILL);
      const int code = daemon_->wait();
      const std::string& said = daemon_->err();
      throw Violation(std::string(error.what()) + (is_there ? "; it still ran" : "; it ended with code ") +
                      (is_there ? "" : std::to_string(code)) +
                      "; its last words: " + said.substr(said.size() > 2000 ? said.size() - 2000 : 0));
    }
  }

  void rest() {
    start({});
    if (!check()) throw Violation("the daemon ended by itself: " + daemon_->err());
    Connection daemon(address_);
    for (Traffic& client : clients_) client.finish_uploads(daemon);
    for (Traffic& client : clients_)
      for (KnownJob& job : client.model.jobs) {
        if (job.is_deleted || job.end) continue;
        const std::string reason =
            daemon.watch_to_the_end(job.id, [&](const v1::RegistrationJob& said) { client.model.observe(job, said); });
        if (!reason.empty() || !job.end) throw Violation("job " + job.id + " does not come to an end: " + reason);
      }
    daemon_->signal(SIGTERM);
    if (const int code = daemon_->wait(); code != 0)
      throw Violation("an orderly stop ended with code " + std::to_string(code));
    start({});
    if (!check()) throw Violation("the daemon ended by itself: " + daemon_->err());
    Connection(address_).collect_garbage();
    Connection(address_).check_blobs();
    ++checks_;
    kill_daemon();
  }

  const fs::path programs_;
  fs::path folder_, record_;
  std::mt19937 generator_;
  std::deque<Traffic> clients_;
  std::optional<ChildProcess> daemon_;
  std::string address_, plan_, place_;
  bool cuts_power_ = false, checks_blobs_ = false;
  int cycle_ = 0, deaths_ = 0, kills_ = 0, worker_kills_ = 0, cuts_ = 0, checks_ = 0;
  std::map<std::string, int> deaths_at_;
  Losses losses_;
};

int number(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  return text ? std::atoi(text) : otherwise;
}

}  // namespace
}  // namespace saltus::crash

int main(int, char** arguments) {
  using namespace saltus::crash;
  const int cycles = number("SALTUS_CRASH_CYCLES", 100), seed = number("SALTUS_CRASH_SEED", 1);
  std::optional<Harness> harness;
  try {
    harness.emplace(std::filesystem::absolute(arguments[0]).parent_path(), static_cast<unsigned>(seed));
    harness->run(cycles);
    std::cout << cycles << " cycles with seed " << seed << ": nothing lost. ";
    harness->summarise(std::cout);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "seed " << seed << ", " << (harness ? harness->where() : "start") << ": " << error.what() << std::endl;
    return 1;
  }
}
