#include "tests/crash/harness.h"

#include "core/image_io/write_image.h"
#include "tests/support/blob_pair.h"

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <ostream>
#include <set>
#include <sstream>
#include <thread>

namespace saltus::crash {
namespace fs = std::filesystem;
namespace {

constexpr int clients = 3;
constexpr int fewest_actions = 5, most_actions = 25;  ///< of each client in a cycle
/// With a named place clients go on until a process has died there, but not for ever.
constexpr std::chrono::seconds patience{10};
/// A named place in so many of 100 cycles; the others end at random or in order.
constexpr int named_share = 80, orderly_share = 8;
/// How long what nobody refers to is kept, and jobs after their end, and a little more.
constexpr int days_of_inputs = 8, days_of_results = 31;

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

bool has_ended(const testing_support::ChildProcess& process) {
  return testing_support::ProcessHandle(process.id()).ends_within(std::chrono::milliseconds(0));
}

/// A failure of one of several threads, told when all have ended.
class Failures {
 public:
  template <class Work>
  std::jthread thread(Work work) {
    std::exception_ptr& error = errors_.emplace_back();
    return std::jthread([&error, work = std::move(work)] {
      try {
        work();
      } catch (const DaemonGone&) {
        // It was to be killed.
      } catch (...) {
        error = std::current_exception();
      }
    });
  }
  void rethrow() const {
    for (const auto& error : errors_)
      if (error) std::rethrow_exception(error);
  }

 private:
  std::deque<std::exception_ptr> errors_;
};

}  // namespace

Harness::Harness(fs::path programs, unsigned seed) : programs_(std::move(programs)), generator_(seed) {
  std::string name = fs::temp_directory_path() / "saltus_crash_XXXXXX";
  if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder can be made");
  folder_ = name;
  armed_ = folder_ / "armed";
  once_ = folder_ / "once";
  deaths_record_ = folder_ / "deaths";
  disk_record_ = folder_ / "disk";
  synced_copies_ = folder_ / "synced";
  // Workers whose daemon was killed become children of this process, which ends them.
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  make_clients(seed);
}

Harness::~Harness() {
  daemon_.reset();
  end_orphans();
}

void Harness::run(int cycles) {
  for (cycle_ = 1; cycle_ <= cycles; ++cycle_) run_cycle();
  come_to_rest();
  fs::remove_all(folder_);
}

std::string Harness::where() const {
  return "cycle " + std::to_string(cycle_) + " (" + plan_text_ + "), data in " + folder_.string();
}

void Harness::summarise(std::ostream& out) const {
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
  v1::CollectGarbageResponse collected = collected_;
  for (const Traffic& client : clients_) {
    collected.set_jobs(collected.jobs() + client.collected.jobs());
    collected.set_blobs(collected.blobs() + client.collected.blobs());
    collected.set_uploads(collected.uploads() + client.collected.uploads());
  }
  out << "Garbage of " << Model::era.days_ahead << " days: " << collected.jobs() << " jobs, " << collected.blobs()
      << " blobs, " << collected.uploads() << " uploads that nobody went on with.\n";
  out << deaths_ << " deaths at a named place, " << kills_ << " of the daemon at random, " << stops_
      << " orderly stops while all were busy, " << worker_kills_ << " workers killed at random; " << cuts_
      << " power cuts, which took the ends of " << losses_.files << " files, " << losses_.names << " names and "
      << losses_.sectors << " sectors of the database; " << checks_ << " checks of all blobs.\nEnds:";
  for (const auto& [state, count] : ends) out << ' ' << count << ' ' << state;
  out << "\nDeaths:";
  places_.print(out);
  out << '\n';
}

void Harness::start(const std::map<std::string, std::string>& environment) {
  const std::string socket = (folder_ / "socket").string();
  std::map<std::string, std::string> variables{{"OMP_NUM_THREADS", "1"},
                                               {"SALTUS_DISK_RECORD", disk_record_.string()},
                                               {"SALTUS_SYNCED_COPY", synced_copies_.string()}};
  variables["SALTUS_DAYS_AHEAD"] = std::to_string(Model::era.days_ahead);
  variables.insert(environment.begin(), environment.end());
  Model::era.begin_daemon();
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

bool Harness::check() {
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

void Harness::make_clients(unsigned seed) {
  plan_text_ = "start";
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
  // Whoever asks for them keeps them from being collected.
  for (const auto& input : {real.fixed(), real.moving()}) clients_.front().model.uploads.push_back(input.digest());
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

void Harness::kill_daemon() {
  daemon_->signal(SIGKILL);
  daemon_->wait();
  daemon_.reset();
}

Harness::Plan Harness::make_plan() {
  Plan plan;
  const int kind = random_below(100);
  plan.kills_worker = random_below(100) < 30;
  plan.cuts_power = random_below(100) < 25;
  plan.checks_blobs = random_below(100) < 5;
  plan.collects = random_below(100) < 20;
  if (kind < named_share) {
    plan.place = places_.choose(generator_);
    plan.is_armed_from_start = random_below(100) < 15;
    plan.text = std::string(plan.place->place->name) + ":" + std::to_string(plan.place->pass) +
                (plan.is_armed_from_start ? " from the start" : "");
    plan.collects |= plan.place->place->needs_garbage;
  }
  if (plan.collects) plan.days = random_below(2) * days_of_inputs;
  if (plan.place) return plan;
  plan.actions_before_end = 1 + random_below(clients * most_actions);
  plan.is_orderly = kind < named_share + orderly_share;
  // A stop has to end a check, too.
  plan.checks_blobs |= plan.is_orderly;
  plan.text = plan.is_orderly ? "stopped in order" : "killed at random";
  return plan;
}

void Harness::run_cycle() {
  const Plan plan = make_plan();
  plan_text_ = plan.text;
  Model::era.days_ahead += plan.days;
  for (const fs::path& file : {armed_, once_, deaths_record_}) fs::remove(file);
  std::map<std::string, std::string> environment;
  if (plan.place) {
    environment = {{"SALTUS_FAILPOINT", std::string(plan.place->place->name) + ":" + std::to_string(plan.place->pass)},
                   {"SALTUS_FAILPOINT_ARMED", armed_.string()},
                   {"SALTUS_FAILPOINT_RECORD", deaths_record_.string()}};
    // One worker, or every one that comes there: then jobs come to their end as poison.
    if (random_below(3) > 0) {
      environment["SALTUS_FAILPOINT_ONCE"] = once_.string();
      std::ofstream(once_) << "yes";
    }
  }
  if (plan.is_armed_from_start) std::ofstream(armed_) << "yes";
  bool has_started = false;
  try {
    start(environment);
    has_started = true;
  } catch (const std::runtime_error&) {
    // It came to its place before it could listen; then, and only then, its end by force is no fault.
    if (!plan.is_armed_from_start || deaths_in(deaths_record_) == 0) throw;
  }
  if (has_started) {
    if (check()) {
      std::ofstream(armed_) << "yes";
      traffic(plan);
    } else if (!plan.is_armed_from_start) {
      throw Violation("the daemon ended by itself: " + daemon_->err());
    }
  }
  end_daemon(plan);
  count_deaths(plan);
  if (plan.cuts_power)
    cut_power_here();
  else if (random_below(4) == 0)
    end_orphans();
}

void Harness::end_daemon(const Plan& plan) {
  if (plan.is_orderly) {
    if (const int code = daemon_->wait(); code != 0)
      throw Violation("an orderly stop ended with code " + std::to_string(code) + ": " + daemon_->err());
  } else {
    daemon_->signal(SIGKILL);
    if (const int code = daemon_->wait(); code != 128 + SIGKILL)
      throw Violation("the daemon ended by itself with code " + std::to_string(code) + ": " + daemon_->err());
  }
  daemon_.reset();
}

void Harness::count_deaths(const Plan& plan) {
  const int deaths = deaths_in(deaths_record_);
  if (plan.place) places_.died(*plan.place, deaths);
  deaths_ += deaths;
  if (plan.is_orderly)
    ++stops_;
  else if (deaths == 0)
    ++kills_;
}

/// All processes end, and what is not on the disk is gone.
void Harness::cut_power_here() {
  end_orphans();
  cut_power(disk_record_, losses_);
  cut_power_of_database(folder_ / "data" / "saltusd.db", synced_copies_, generator_, losses_);
  ++cuts_;
  plan_text_ += ", then the power was cut";
}

void Harness::kill_random_worker() {
  const auto workers = children_of(daemon_->id());
  if (workers.empty()) return;
  ::kill(workers[static_cast<std::size_t>(random_below(static_cast<int>(workers.size())))], SIGKILL);
  ++worker_kills_;
}

void Harness::traffic(const Plan& plan) {
  std::atomic<int> done = 0, running = clients;
  const auto end = std::chrono::steady_clock::now() + patience;
  Failures failures;
  std::vector<std::jthread> threads;
  for (Traffic& client : clients_) {
    const int actions = fewest_actions + random_below(most_actions - fewest_actions);
    threads.push_back(failures.thread([&, actions] {
      int own = 0;
      client.run(address_, plan.collects, [&] {
        ++done;
        done.notify_all();
        ++own;
        // Until the end comes, or for as long as it takes somebody to come to the place.
        if (plan.actions_before_end > 0 || own < actions) return Pace::Busy;
        const bool waits = deaths_in(deaths_record_) == 0 && std::chrono::steady_clock::now() < end;
        return waits ? Pace::Patient : Pace::Stop;
      });
      --running;
      ++done;
      done.notify_all();
    }));
  }
  if (plan.checks_blobs) {
    ++checks_;
    threads.push_back(failures.thread([this] { Connection(address_).check_blobs(); }));
  }
  if (plan.kills_worker) kill_random_worker();
  if (plan.actions_before_end > 0) {
    // In the middle of what the clients do.
    for (int now = done; now < plan.actions_before_end && running > 0; now = done) done.wait(now);
    daemon_->signal(plan.is_orderly ? SIGTERM : SIGKILL);
  }
  threads.clear();
  failures.rethrow();
}

/// Ends the workers that a killed daemon has left.
void Harness::end_orphans() {
  for (const pid_t child : children_of(getpid())) {
    ::kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
  }
}

/// Nobody disturbs any more: every job must come to an end, and stay there.
void Harness::come_to_rest() {
  plan_text_ = "coming to rest";
  try {
    rest();
  } catch (const DaemonGone& error) {
    const bool is_there = !has_ended(*daemon_);
    if (is_there) daemon_->signal(SIGKILL);
    const int code = daemon_->wait();
    const std::string& said = daemon_->err();
    throw Violation(std::string(error.what()) + (is_there ? "; it still ran" : "; it ended with code ") +
                    (is_there ? "" : std::to_string(code)) +
                    "; its last words: " + said.substr(said.size() > 2000 ? said.size() - 2000 : 0));
  }
}

void Harness::rest() {
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
  stop_in_order();
  start({});
  if (!check()) throw Violation("the daemon ended by itself: " + daemon_->err());
  Connection(address_).check_blobs();
  ++checks_;
  kill_daemon();
  clear();
  // Whoever asks for many cycles is to know that every place was among them.
  if (places_.fewest() < cycle_ / 50)
    throw Violation("there is a place at which only " + std::to_string(places_.fewest()) + " processes have died");
}

void Harness::stop_in_order() {
  daemon_->signal(SIGTERM);
  if (const int code = daemon_->wait(); code != 0)
    throw Violation("an orderly stop ended with code " + std::to_string(code));
  daemon_.reset();
}

void Harness::collect_after(int days) {
  Model::era.days_ahead += days;
  ++Model::era.collections;
  start({});
  const v1::CollectGarbageResponse said = Connection(address_).collect_garbage();
  collected_.set_jobs(collected_.jobs() + said.jobs());
  collected_.set_blobs(collected_.blobs() + said.blobs());
  collected_.set_uploads(collected_.uploads() + said.uploads());
}

void Harness::clear() {
  plan_text_ = "clearing";
  // Once to notice what nobody refers to, and once to remove it: nobody asks for it in between.
  collect_after(days_of_inputs);
  observe_all(Connection(address_).list_all());
  stop_in_order();
  collect_after(days_of_inputs);
  check_what_is_needed();
  stop_in_order();
  collect_after(days_of_results);
  stop_in_order();
  collect_after(days_of_inputs);
  if (!Connection(address_).list_all().empty()) throw Violation("jobs are kept for longer than their results");
  const auto left = Connection(address_).check_blobs();
  if (!left || left->blobs() + left->uploads() + left->orphans() > 0)
    throw Violation("garbage is left: " + (left ? left->ShortDebugString() : "nobody knows what"));
  stop_in_order();
}

std::set<std::string> Harness::observe_all(const std::vector<v1::RegistrationJob>& listed) {
  std::map<std::string, const v1::RegistrationJob*> by_id;
  for (const v1::RegistrationJob& job : listed) by_id[job.id()] = &job;
  std::set<std::string> inputs;
  for (Traffic& client : clients_)
    for (KnownJob& job : client.model.jobs) {
      if (job.is_deleted) continue;
      if (by_id.contains(job.id)) {
        client.model.observe(job, *by_id[job.id]);
      } else {
        client.model.observe_absence(job);
        inputs.insert({job.request.spec().fixed().digest(), job.request.spec().moving().digest()});
      }
    }
  return inputs;
}

void Harness::check_what_is_needed() {
  Connection daemon(address_);
  const auto listed = daemon.list_all();
  std::set<std::string> needed;
  for (const v1::RegistrationJob& job : listed) {
    needed.insert({job.spec().fixed().digest(), job.spec().moving().digest()});
    for (const v1::Artifact& artifact : job.artifacts()) needed.insert(artifact.digest());
  }
  for (const std::string& digest : needed)
    if (digest_of(daemon.download(digest)) != digest) throw Violation("blob " + digest + " has other bytes");
  std::vector<std::string> known;
  for (Traffic& client : clients_) {
    known.insert(known.end(), client.model.uploads.begin(), client.model.uploads.end());
    for (KnownJob& job : client.model.jobs)
      if (!job.own_input.empty()) known.push_back(job.own_input);
  }
  // The last collection has removed some jobs first, and nobody refers to their inputs only since then.
  needed.merge(observe_all(listed));
  // What is no longer needed is gone, all of it.
  std::erase_if(known, [&](const std::string& digest) { return needed.contains(digest); });
  if (const auto missing = daemon.missing(known); missing.size() != known.size())
    throw Violation("of " + std::to_string(known.size()) + " blobs that nobody needs only " +
                    std::to_string(missing.size()) + " were removed");
}

}  // namespace saltus::crash
