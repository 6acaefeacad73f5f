#include "server/launch/slurm_launcher.h"

#include "core/support/failpoint.h"
#include "server/launch/worker_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <utility>
#include <vector>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

constexpr const char* kPrefix = "slurm ";
constexpr std::chrono::milliseconds kLongestPilotPause = std::chrono::minutes(10);
constexpr std::size_t kIdsOfOneCall = 100;  // of scancel

/// A limit of the site, or a controller that is overworked: no fault of the submission.
bool is_to_be_waited_for(const std::string& errors) {
  return errors.find("imit") != std::string::npos || errors.find("temporarily") != std::string::npos;
}

/// No node has what the submission asks for, or the partition forbids it.
bool can_never_be_taken(const std::string& errors) {
  for (const char* text : {"Requested node configuration is not available", "Requested time limit is invalid",
                           "CPU count per node can not be satisfied", "More processors requested than permitted",
                           "Node count specification invalid"})
    if (errors.find(text) != std::string::npos) return true;
  return false;
}

/// What sbatch says of itself begins with its name.
std::string refusal_of(const CommandResult& result) {
  const std::string told = describe(result);
  return told.starts_with("sbatch") ? told : "sbatch: " + told;
}

void sync(const fs::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool is_synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int code = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!is_synced) throw std::runtime_error("cannot sync " + path.string() + ": " + std::strerror(code));
}

/// What --parsable prints is "17" or "17;cluster".
std::optional<std::string> id_of(const std::string& output) {
  const auto end = output.find_first_not_of("0123456789");
  const std::string id = output.substr(0, end);
  const bool is_whole = end == std::string::npos || output[end] == '\n' || output[end] == ';';
  return id.empty() || !is_whole ? std::nullopt : std::optional(id);
}

}  // namespace

SlurmLauncher::SlurmLauncher(SlurmSettings settings, std::shared_ptr<const Clock> clock, CommandRunner run,
                             bool has_thread)
    : settings_(std::move(settings)), clock_(std::move(clock)), run_(std::move(run)), has_thread_(has_thread) {}

SlurmLauncher::~SlurmLauncher() {
  thread_.request_stop();
  changed_.notify_all();
}

void SlurmLauncher::on_exit(ExitHandler handler) {
  on_exit_ = std::move(handler);
  if (has_thread_) thread_ = std::jthread([this](std::stop_token stop) { work(std::move(stop)); });
}

void SlurmLauncher::set_server_address(const std::string& address) {
  std::lock_guard lock(mutex_);
  settings_.batch.server_address = address;
}

std::string SlurmLauncher::name_of(const AttemptKey& key) const {
  return kPrefix + ("saltus-" + settings_.tag + "-") + file_name_of(key);
}

fs::path SlurmLauncher::token_file(const AttemptKey& key) const {
  return settings_.run / (file_name_of(key) + ".token");
}

std::string SlurmLauncher::start(const LaunchRequest& request) {
  {
    std::lock_guard lock(mutex_);
    attempts_[request.key].request = request;
  }
  wake();
  return name_of(request.key);
}

bool SlurmLauncher::adopt(const AttemptKey& key, const std::string& process) {
  if (process != name_of(key)) return false;
  {
    std::lock_guard lock(mutex_);
    attempts_[key].place = Attempt::Place::Submitted;
  }
  wake();
  return true;
}

void SlurmLauncher::terminate(const AttemptKey& key) {
  {
    std::lock_guard lock(mutex_);
    const auto found = attempts_.find(key);
    if (found == attempts_.end() || found->second.is_unwanted) return;
    found->second.is_unwanted = true;
  }
  wake();
}

void SlurmLauncher::kill(const AttemptKey& key) {
  {
    std::lock_guard lock(mutex_);
    const auto found = attempts_.find(key);
    if (found == attempts_.end() || found->second.is_to_be_killed) return;
    found->second.is_unwanted = found->second.is_to_be_killed = true;
    found->second.next_cancel.reset();
  }
  wake();
}

void SlurmLauncher::want_pilots(int waiting_jobs) {
  {
    std::lock_guard lock(mutex_);
    if (std::exchange(wanted_, waiting_jobs) > 0 || waiting_jobs == 0) return;
  }
  wake();
}

bool SlurmLauncher::is_idle() const {
  std::lock_guard lock(mutex_);
  return attempts_.empty();
}

void SlurmLauncher::wake() {
  {
    std::lock_guard lock(mutex_);
    has_work_ = true;
  }
  changed_.notify_all();
}

void SlurmLauncher::work(std::stop_token stop) {
  stop_ = stop;
  while (!stop.stop_requested()) {
    const SteadyTime next = step();
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, next - clock_->steady(), [this] { return has_work_; });
    has_work_ = false;
  }
}

CommandResult SlurmLauncher::run(const Command& command) { return run_(command, settings_.command_limit, stop_); }

SteadyTime SlurmLauncher::step() {
  drop_what_was_not_submitted();
  bool has_attempts = false;
  {
    std::lock_guard lock(mutex_);
    has_attempts = !attempts_.empty() || (settings_.pilots.most > 0 && wanted_ > 0);
  }
  const SteadyTime now = clock_->steady();
  // What an earlier daemon has left is looked for once, even when no attempt is known.
  const bool has_to_look = has_attempts || !has_looked_ || has_strays_;
  if (has_to_look && now >= next_look_) {
    next_look_ = now + settings_.poll;
    is_away_ = !look();
    if (!is_away_) is_in_doubt_ = false;
    has_looked_ = has_looked_ || !is_away_;
  }
  if (!is_away_ && has_looked_) {
    cancel_unwanted();
    while (!is_in_doubt_ && submit_next()) {
    }
    if (!is_in_doubt_) submit_pilots();
  }
  tell();
  return next_look_;
}

void SlurmLauncher::failed(const std::string& command, const CommandResult& result) {
  if (result.end == CommandResult::End::Stopped) return;
  if (!is_away_) settings_.log("Slurm does not answer, jobs wait until it does: " + command + ": " + describe(result));
}

bool SlurmLauncher::look() {
  const CommandResult result = run(listing());
  const auto rows = result.is_good() ? parse_listing(result.output) : std::nullopt;
  if (!rows) {
    failed("squeue", result);
    std::lock_guard lock(mutex_);
    for (auto& [key, attempt] : attempts_) {
      if (attempt.place == Attempt::Place::Uncertain) attempt.is_excused = true;
      if (!attempt.told || !attempt.told->has_its_turn)
        tell_news(key, attempt, {attempt.batch_id, false, "", "Slurm does not answer"});
    }
    return false;
  }
  if (is_away_) settings_.log("Slurm answers again");
  reconcile(*rows, clock_->steady());
  return true;
}

void SlurmLauncher::reconcile(const std::vector<BatchRow>& rows, SteadyTime now) {
  const std::string mark = "saltus-" + settings_.tag + "-";
  std::map<std::string, std::vector<const BatchRow*>> by_name;
  for (const BatchRow& row : rows)
    if (row.name.starts_with(mark)) by_name[row.name].push_back(&row);
  const auto pilots = by_name.extract(name_of_pilots());
  count_pilots(pilots ? pilots.mapped() : std::vector<const BatchRow*>(), now);
  strays_.clear();
  std::vector<std::pair<AttemptKey, WorkerExit>> ended;
  {
    std::lock_guard lock(mutex_);
    for (auto& [key, attempt] : attempts_) {
      const auto found = by_name.extract(name_of(key).substr(std::string(kPrefix).size()));
      // What sbatch refuses may be in the queue nevertheless, as a job that has failed.
      if (found && attempt.place != Attempt::Place::Submitted)
        std::erase_if(found.mapped(), [](const BatchRow* row) { return was_never_possible(*row); });
      if (!found || found.mapped().empty()) {
        if (attempt.place == Attempt::Place::Submitted) ended.emplace_back(key, WorkerExit{WorkerExit::Kind::Vanished});
        if (attempt.place != Attempt::Place::Uncertain) continue;
        attempt.place = Attempt::Place::ToSubmit;
        if (std::exchange(attempt.is_excused, false)) continue;
        if (!attempt.refused) attempt.refused = now;
        attempt.not_before = now + settings_.poll;
        if (now - *attempt.refused >= settings_.refusal_patience)
          ended.emplace_back(
              key, WorkerExit{attempt.is_hopeless ? WorkerExit::Kind::NeverStarts : WorkerExit::Kind::Refused, 0,
                              attempt.refusal});
        continue;
      }
      // Of two with one token, one lives: the one that we know, or the first that has not ended.
      const BatchRow* own = found.mapped().front();
      for (const BatchRow* row : found.mapped())
        if (row->id == attempt.batch_id || (own->id != attempt.batch_id && end_of(*own) && !end_of(*row))) own = row;
      for (const BatchRow* row : found.mapped())
        if (row != own && !end_of(*row)) strays_.insert(row->id);
      const auto exit = follow(key, attempt, *own, now);
      if (exit) ended.emplace_back(key, *exit);
      if (exit && !end_of(*own)) strays_.insert(own->id);
    }
  }
  for (const auto& [name, unknown] : by_name)
    for (const BatchRow* row : unknown)
      if (!end_of(*row)) strays_.insert(row->id);
  has_strays_ = !strays_.empty();
  for (auto& [key, exit] : ended) end(key, std::move(exit));
}

void SlurmLauncher::count_pilots(const std::vector<const BatchRow*>& rows, SteadyTime now) {
  pilots_ = pending_pilots_ = 0;
  std::set<std::string> spoiled;
  bool is_new = false;
  std::string reason;
  for (const BatchRow* row : rows) {
    const auto exit = end_of(*row);
    pilots_ += exit ? 0 : 1;
    pending_pilots_ += is_pending(*row) ? 1 : 0;
    if (can_never_start(*row)) reason = row->reason;
    const bool is_bad = exit && (exit->kind == WorkerExit::Kind::Signalled || exit->number != 0);
    if (!is_bad) continue;
    spoiled.insert(row->id);
    is_new = is_new || !spoiled_pilots_.contains(row->id);
  }
  spoiled_pilots_ = std::move(spoiled);
  if (std::exchange(pilot_reason_, reason) != reason && !reason.empty())
    settings_.log("Slurm says that pilots can never start there (" + reason +
                  "), and jobs wait; see --threads-per-job, --slurm-pilot-memory and --slurm-option");
  // One that works shows that nothing is wrong with all of them.
  if (!is_new && pilots_ > pending_pilots_) pilot_pause_ = {};
  if (!is_new) return;
  // Whatever is wrong (a program that is not there, a certificate) would be wrong with the next ones.
  pilot_pause_ = std::clamp(2 * pilot_pause_, settings_.poll, kLongestPilotPause);
  next_pilots_ = now + pilot_pause_;
  settings_.log("a pilot has ended badly in Slurm (" + *spoiled_pilots_.rbegin() +
                "); the next ones are submitted in " + std::to_string(pilot_pause_.count() / 1000) + " s");
}

std::optional<WorkerExit> SlurmLauncher::follow(const AttemptKey& key, Attempt& attempt, const BatchRow& row,
                                                SteadyTime now) {
  attempt.place = Attempt::Place::Submitted;
  attempt.batch_id = row.id;
  const bool has_its_turn = !is_pending(row);
  tell_news(key, attempt, {row.id, has_its_turn, row.host, has_its_turn ? "" : row.reason});
  if (auto exit = end_of(row)) return exit;
  if (!can_never_start(row)) {
    attempt.refused.reset();
    return std::nullopt;
  }
  if (!attempt.refused) attempt.refused = now;
  if (now - *attempt.refused < settings_.refusal_patience) return std::nullopt;
  return WorkerExit{WorkerExit::Kind::NeverStarts, 0, row.reason};
}

void SlurmLauncher::tell_news(const AttemptKey& key, Attempt& attempt, QueueNews news) {
  if (attempt.told == news) return;
  attempt.told = news;
  to_tell_.push_back({key, std::move(news), {}});
}

void SlurmLauncher::end(const AttemptKey& key, WorkerExit exit) {
  std::error_code ignored;  // files that are not there any more are no loss
  if (!settings_.batch.shared_data.empty()) {
    fs::remove(token_file(key), ignored);
    if (exit.kind == WorkerExit::Kind::Exited && exit.number == 0)
      fs::remove(settings_.logs / (file_name_of(key) + ".log"), ignored);
  }
  std::lock_guard lock(mutex_);
  to_tell_.push_back({key, {}, std::move(exit)});
}

void SlurmLauncher::tell() {
  std::vector<Told> told;
  {
    std::lock_guard lock(mutex_);
    told.swap(to_tell_);
  }
  for (const Told& one : told) {
    if (one.news) on_news_(one.key, *one.news);
    if (!one.exit) continue;
    on_exit_(one.key, *one.exit);
    std::lock_guard lock(mutex_);
    attempts_.erase(one.key);
  }
}

void SlurmLauncher::drop_what_was_not_submitted() {
  std::vector<AttemptKey> dropped;
  {
    std::lock_guard lock(mutex_);
    for (const auto& [key, attempt] : attempts_)
      if (attempt.is_unwanted && attempt.place == Attempt::Place::ToSubmit) dropped.push_back(key);
  }
  for (const AttemptKey& key : dropped) end(key, {WorkerExit::Kind::Vanished});
  tell();
}

void SlurmLauncher::cancel_unwanted() {
  const SteadyTime now = clock_->steady();
  std::vector<std::string> ids(strays_.begin(), strays_.end()), by_force;
  // Those that are still there at the next look are named again.
  strays_.clear();
  {
    std::lock_guard lock(mutex_);
    for (auto& [key, attempt] : attempts_) {
      const bool is_due = !attempt.next_cancel || now >= *attempt.next_cancel;
      if (!attempt.is_unwanted || attempt.batch_id.empty() || !is_due) continue;
      ids.push_back(attempt.batch_id);
      if (attempt.is_to_be_killed) by_force.push_back(attempt.batch_id);
      attempt.next_cancel = now + settings_.poll;
    }
  }
  scancel(ids, false);
  scancel(by_force, true);
}

void SlurmLauncher::scancel(const std::vector<std::string>& ids, bool by_force) {
  for (std::size_t begin = 0; begin < ids.size(); begin += kIdsOfOneCall) {
    const auto end = std::min(ids.size(), begin + kIdsOfOneCall);
    Command command{{"scancel"}, ""};
    if (by_force) command.arguments.insert(command.arguments.end(), {"--signal=KILL", "--full"});
    command.arguments.insert(command.arguments.end(), ids.begin() + static_cast<std::ptrdiff_t>(begin),
                             ids.begin() + static_cast<std::ptrdiff_t>(end));
    const CommandResult result = run(command);
    // One that has just ended by itself is an error of scancel's, and none of ours. What is still there at the next
    // look is cancelled again.
    if (!result.is_good() && result.end != CommandResult::End::Exited) failed("scancel", result);
  }
}

Command SlurmLauncher::command_for(const LaunchRequest& request) {
  BatchRequest batch;
  batch.name = name_of(request.key).substr(std::string(kPrefix).size());
  batch.threads = request.threads;
  batch.memory_bytes = std::max(request.memory_bytes, request.limits.memory_bytes);
  batch.wall_seconds = request.limits.wall_seconds;
  const std::string& shared = settings_.batch.shared_data;
  batch.worker_arguments = {"--job",   request.key.job_id, "--attempt", std::to_string(request.key.attempt),
                            "--guard", "--token-file"};
  if (shared.empty()) {
    batch.worker_arguments.push_back("-");
    batch.input = request.token;
  } else {
    keep_newest(settings_.logs, settings_.max_logs);
    write_secret(token_file(request.key), request.token);
    batch.worker_arguments.push_back(shared + "/run/" + token_file(request.key).filename().string());
    batch.output = shared + "/logs/" + file_name_of(request.key) + ".log";
  }
  std::lock_guard lock(mutex_);
  return submission(settings_.batch, batch);
}

bool SlurmLauncher::submit_next() {
  const SteadyTime now = clock_->steady();
  std::optional<LaunchRequest> next;
  {
    std::lock_guard lock(mutex_);
    for (const auto& [key, attempt] : attempts_)
      if (attempt.place == Attempt::Place::ToSubmit && attempt.request && !attempt.is_unwanted &&
          (!attempt.not_before || now >= *attempt.not_before)) {
        next = attempt.request;
        break;
      }
    // Before anything else happens: when nobody hears the answer, Slurm's queue tells.
    if (next) attempts_.at(next->key).place = Attempt::Place::Uncertain;
  }
  if (!next) return false;
  CommandResult result;
  try {
    const Command command = command_for(*next);
    SALTUS_FAILPOINT("slurm.submit.before");
    result = run(command);
    SALTUS_FAILPOINT("slurm.submit.after");
  } catch (const std::exception& error) {
    end(next->key, {WorkerExit::Kind::Refused, 0, error.what()});
    return true;
  }
  const auto id = result.is_good() ? id_of(result.output) : std::nullopt;
  std::lock_guard lock(mutex_);
  Attempt& attempt = attempts_.at(next->key);
  if (id) {
    attempt.place = Attempt::Place::Submitted;
    attempt.batch_id = *id;
    attempt.refused.reset();
    tell_news(next->key, attempt, {*id, false});
    return true;
  }
  const std::string refusal = refusal_of(result);
  attempt.is_hopeless = can_never_be_taken(result.errors);
  if (!attempt.is_hopeless && is_to_be_waited_for(result.errors)) attempt.refused.reset();
  if (result.end != CommandResult::End::Stopped) tell_news(next->key, attempt, {"", false, "", refusal});
  if (result.end != CommandResult::End::Stopped && std::exchange(attempt.refusal, refusal) != refusal)
    settings_.log("a submission was not taken and is tried again: " + attempt.refusal);
  // Whether it is there in spite of that, and whether Slurm is there at all, is known after the next look.
  next_look_ = now;
  is_in_doubt_ = true;
  return false;
}

void SlurmLauncher::submit_pilots() {
  BatchRequest batch;
  {
    std::lock_guard lock(mutex_);
    // Those that run have a job, or are about to take one; those that wait are for the jobs that wait.
    batch.array_size = std::min(settings_.pilots.most - pilots_, wanted_ - pending_pilots_);
  }
  if (batch.array_size <= 0 || clock_->steady() < next_pilots_) return;
  const PilotSettings& pilots = settings_.pilots;
  batch.name = name_of_pilots();
  batch.threads = pilots.threads;
  batch.memory_bytes = pilots.memory_bytes;
  batch.worker_arguments = {"--threads",      std::to_string(pilots.threads),
                            "--idle-seconds", std::to_string(pilots.idle_seconds),
                            "--memory-bytes", std::to_string(pilots.memory_bytes)};
  Command command;
  {
    std::lock_guard lock(mutex_);
    command = submission(settings_.batch, batch);
  }
  const CommandResult result = run(command);
  if (result.is_good() && id_of(result.output)) {
    pilots_ += batch.array_size;
    pending_pilots_ += batch.array_size;
    pilot_refusal_.clear();
    return;
  }
  // Slurm may have them nevertheless: the next look tells, and until then no others are submitted.
  is_in_doubt_ = true;
  const std::string refusal = refusal_of(result);
  if (result.end != CommandResult::End::Stopped && std::exchange(pilot_refusal_, refusal) != refusal)
    settings_.log("pilots were not taken and are tried again: " + refusal);
}

std::string tag_of(const fs::path& file, const std::string& fresh) {
  std::string tag;
  std::ifstream(file) >> tag;
  const auto is_sound = [](const std::string& text) {
    return !text.empty() && text.size() <= 32 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
  };
  if (is_sound(tag)) return tag;
  if (fs::exists(file))
    throw std::runtime_error(file.string() +
                             " does not hold the name of this daemon's Slurm jobs; remove it when none " +
                             "of them runs any more");
  const fs::path unsafe = file.string() + ".new";
  write_secret(unsafe, fresh);
  sync(unsafe);
  fs::rename(unsafe, file);
  sync(file.parent_path());
  return fresh;
}

}  // namespace saltus::server
