#include "server/launch/local_launcher.h"

#include "core/support/available_cores.h"
#include "core/support/failpoint.h"
#include "server/launch/process_identity.h"
#include "server/launch/worker_environment.h"
#include "server/launch/worker_files.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <set>
#include <stdexcept>
#include <system_error>
#include <vector>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

constexpr int kLogCheckMilliseconds = 1000;

/// A descriptor that becomes readable when the process ends. glibc 2.36 declares this without C linkage.
int open_process(pid_t pid) { return static_cast<int>(::syscall(SYS_pidfd_open, pid, 0)); }

[[noreturn]] void fail(int code, const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(code));
}

class FileDescriptor {
 public:
  explicit FileDescriptor(int descriptor) : descriptor_(descriptor) {}
  ~FileDescriptor() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return descriptor_; }

 private:
  int descriptor_;
};

class SpawnPlan {
 public:
  explicit SpawnPlan(int log) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addopen(&actions_, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions_, log, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions_, log, STDERR_FILENO);
    posix_spawn_file_actions_addclosefrom_np(&actions_, STDERR_FILENO + 1);
    posix_spawnattr_init(&attributes_);
    posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    posix_spawnattr_setpgroup(&attributes_, 0);
    sigset_t signals;
    sigemptyset(&signals);
    posix_spawnattr_setsigmask(&attributes_, &signals);
    sigfillset(&signals);
    posix_spawnattr_setsigdefault(&attributes_, &signals);
  }
  ~SpawnPlan() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnPlan(const SpawnPlan&) = delete;
  SpawnPlan& operator=(const SpawnPlan&) = delete;

  pid_t spawn(const std::vector<std::string>& arguments, const std::vector<std::string>& environment) const {
    const auto pointers = [](const std::vector<std::string>& texts) {
      std::vector<char*> list;
      for (const std::string& text : texts) list.push_back(const_cast<char*>(text.c_str()));
      list.push_back(nullptr);
      return list;
    };
    pid_t pid = 0;
    const int code = posix_spawn(&pid, arguments.front().c_str(), &actions_, &attributes_, pointers(arguments).data(),
                                 pointers(environment).data());
    if (code != 0) fail(code, arguments.front());
    return pid;
  }

 private:
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
};

/// What names among the uploads begin with that a worker has given, see UploadParts::kGivenId.
constexpr const char* kGiven = "given-";

bool is_given_by(const AttemptKey& key, const std::string& name) {
  return name.starts_with(kGiven + file_name_of(key) + "-");
}

std::vector<std::string> worker_environment(int threads, bool has_cores_alone, const fs::path& temporary_files) {
  auto own = worker_variables(threads, has_cores_alone, std::getenv("GLIBC_TUNABLES"));
  own.emplace_back("TMPDIR", temporary_files.string());
  return environment_with(own);
}

}  // namespace

struct LocalLauncher::Worker {
  Worker(ProcessIdentity process, int pid_descriptor, bool child)
      : identity(std::move(process)), descriptor(pid_descriptor), is_child(child) {}
  ~Worker() { ::close(descriptor); }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  const ProcessIdentity identity;
  const int descriptor;  ///< readable when the process has ended
  const bool is_child;
  bool is_reaped = false;  ///< under the launcher's lock; the number may be another's from then on
};

LocalLauncher::LocalLauncher(LocalLauncherSettings settings) : settings_(std::move(settings)) {
  wake_descriptor_ = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (wake_descriptor_ < 0) fail(errno, "cannot make an event descriptor");
  memory_kills_ = settings_.count_memory_kills();
}

LocalLauncher::~LocalLauncher() {
  {
    std::lock_guard lock(mutex_);
    is_closing_ = true;
  }
  wake();
  if (thread_.joinable()) thread_.join();
  ::close(wake_descriptor_);
}

void LocalLauncher::on_exit(ExitHandler handler) {
  handler_ = std::move(handler);
  thread_ = std::thread([this] { watch(); });
}

void LocalLauncher::set_server_address(const std::string& address) {
  std::lock_guard lock(mutex_);
  settings_.server_address = address;
}

fs::path LocalLauncher::token_file(const AttemptKey& key) const {
  return settings_.run / (file_name_of(key) + ".token");
}

fs::path LocalLauncher::log_file(const AttemptKey& key) const { return settings_.logs / (file_name_of(key) + ".log"); }

fs::path LocalLauncher::work_folder(const AttemptKey& key) const { return settings_.work / file_name_of(key); }

void LocalLauncher::remove_files(const AttemptKey& key) const {
  std::error_code ignored;  // files that are not there any more are no loss
  fs::remove(token_file(key), ignored);
  fs::remove_all(work_folder(key), ignored);
  // What it had given and was killed before the daemon took it.
  for (fs::directory_iterator at(settings_.uploads, ignored), end; !ignored && at != end; at.increment(ignored)) {
    std::error_code gone;
    if (is_given_by(key, at->path().filename())) fs::remove(at->path(), gone);
  }
}

/// Whether threads that wait awake take no core from another worker.
bool LocalLauncher::has_cores_alone() const {
  return settings_.thread_budget > 0 && settings_.thread_budget <= available_cores();
}

std::string LocalLauncher::start(const LaunchRequest& request) {
  try {
    return start_process(request);
  } catch (...) {
    remove_files(request.key);
    std::error_code ignored;
    fs::remove(log_file(request.key), ignored);
    throw;
  }
}

std::string LocalLauncher::start_process(const LaunchRequest& request) {
  const AttemptKey& key = request.key;
  write_secret(token_file(key), request.token);
  fs::create_directories(work_folder(key));
  keep_newest(settings_.logs, settings_.max_logs);
  const FileDescriptor log(::open(log_file(key).c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0600));
  if (log.get() < 0) fail(errno, "cannot write the worker's log");
  SALTUS_FAILPOINT("launch.before");
  // Held until the worker is listed, so that is_idle() cannot miss it.
  std::lock_guard lock(mutex_);
  std::vector<std::string> words{settings_.worker.string(), "--server", settings_.server_address};
  if (!settings_.blobs.empty()) words.insert(words.end(), {"--blobs", settings_.blobs.string()});
  if (!settings_.uploads.empty()) words.insert(words.end(), {"--uploads", settings_.uploads.string()});
  words.insert(words.end(), {"--job", key.job_id, "--attempt", std::to_string(key.attempt), "--token-file",
                             token_file(key).string()});
  const pid_t pid =
      SpawnPlan(log.get()).spawn(words, worker_environment(request.threads, has_cores_alone(), work_folder(key)));
  SALTUS_FAILPOINT("launch.after");
  // The process, even when it has ended already, stays until it is reaped: its number cannot be another's.
  const int descriptor = open_process(pid);
  if (descriptor < 0) {
    const int code = errno;
    ::kill(-pid, SIGKILL);
    waitpid(pid, nullptr, 0);
    fail(code, "cannot watch the worker");
  }
  const ProcessIdentity identity = identify(pid).value_or(ProcessIdentity{pid, "0", "ended"});
  workers_[key] = std::make_shared<Worker>(identity, descriptor, true);
  wake();
  return identity.to_text();
}

bool LocalLauncher::adopt(const AttemptKey& key, const std::string& process) {
  const auto identity = parse_identity(process);
  if (!identity || identify(identity->pid) != identity) return false;
  const int descriptor = open_process(identity->pid);
  if (descriptor < 0) return false;
  auto worker = std::make_shared<Worker>(*identity, descriptor, false);
  if (identify(identity->pid) != identity)
    return false;  // ended, and the number reused, before the descriptor was opened
  {
    std::lock_guard lock(mutex_);
    workers_[key] = std::move(worker);
  }
  wake();
  return true;
}

void LocalLauncher::signal(const AttemptKey& key, int number) {
  std::lock_guard lock(mutex_);
  const auto found = workers_.find(key);
  if (found == workers_.end()) return;
  const Worker& worker = *found->second;
  if (worker.is_reaped) return;
  if (!worker.is_child && identify(worker.identity.pid) != worker.identity) return;
  ::kill(-worker.identity.pid, number);
}

void LocalLauncher::terminate(const AttemptKey& key) { signal(key, SIGTERM); }
void LocalLauncher::kill(const AttemptKey& key) { signal(key, SIGKILL); }

bool LocalLauncher::is_idle() const {
  std::lock_guard lock(mutex_);
  return workers_.empty();
}

void LocalLauncher::wake() {
  const std::uint64_t one = 1;
  // Fails only when a wake is pending already.
  [[maybe_unused]] const ssize_t count = ::write(wake_descriptor_, &one, sizeof one);
}

void LocalLauncher::watch() {
  while (true) {
    std::vector<std::pair<AttemptKey, std::shared_ptr<Worker>>> workers;
    {
      std::lock_guard lock(mutex_);
      if (is_closing_) return;
      workers.assign(workers_.begin(), workers_.end());
    }
    std::vector<pollfd> polled{{wake_descriptor_, POLLIN, 0}};
    for (const auto& [key, worker] : workers) polled.push_back({worker->descriptor, POLLIN, 0});
    if (::poll(polled.data(), polled.size(), workers.empty() ? -1 : kLogCheckMilliseconds) < 0) continue;
    if (polled[0].revents) {
      std::uint64_t count = 0;
      [[maybe_unused]] const ssize_t size = ::read(wake_descriptor_, &count, sizeof count);
    }
    for (std::size_t i = 0; i < workers.size(); ++i)
      if (polled[i + 1].revents) reap(workers[i].first, *workers[i].second);
    limit_logs();
  }
}

void LocalLauncher::reap(const AttemptKey& key, Worker& worker) {
  {
    std::lock_guard lock(mutex_);
    // What the worker has started must not outlive it.
    ::kill(-worker.identity.pid, SIGKILL);
    worker.is_reaped = true;
  }
  WorkerExit exit{WorkerExit::Kind::Vanished, 0};
  if (worker.is_child) {
    int status = 0;
    while (waitpid(worker.identity.pid, &status, 0) < 0 && errno == EINTR) {
    }
    if (WIFSIGNALED(status))
      exit = {WorkerExit::Kind::Signalled, WTERMSIG(status),
              WTERMSIG(status) == SIGKILL && was_memory_kill() ? "the kernel ended it because no memory was left" : ""};
    else
      exit = {WorkerExit::Kind::Exited, WEXITSTATUS(status)};
  }
  remove_files(key);
  std::error_code ignored;
  if (exit.kind == WorkerExit::Kind::Exited && exit.number == 0) fs::remove(log_file(key), ignored);
  SALTUS_FAILPOINT("reap.before");
  handler_(key, exit);
  std::lock_guard lock(mutex_);
  workers_.erase(key);
}

bool LocalLauncher::was_memory_kill() {
  const auto count = settings_.count_memory_kills();
  if (!count || !memory_kills_ || *count <= *memory_kills_) return false;
  // One for each death: of two that are killed at the same time, the second is told so as well.
  ++*memory_kills_;
  return true;
}

void LocalLauncher::limit_logs() {
  std::vector<AttemptKey> keys;
  {
    std::lock_guard lock(mutex_);
    for (const auto& [key, worker] : workers_) keys.push_back(key);
  }
  for (const AttemptKey& key : keys) {
    std::error_code error;
    const auto size = fs::file_size(log_file(key), error);
    // Workers write in append mode, so they go on at the new end.
    if (!error && static_cast<std::int64_t>(size) > settings_.max_log_bytes) fs::resize_file(log_file(key), 0, error);
  }
}

void LocalLauncher::remove_stale_files() {
  std::lock_guard lock(mutex_);
  std::set<fs::path> kept;
  for (const auto& [key, worker] : workers_) kept.insert({token_file(key), work_folder(key)});
  for (const fs::path& folder : {settings_.run, settings_.work}) {
    if (!fs::exists(folder)) continue;
    for (const auto& entry : fs::directory_iterator(folder))
      if (!kept.contains(entry.path())) fs::remove_all(entry.path());
  }
  if (!fs::exists(settings_.uploads)) return;
  const auto is_of_worker = [this](const std::string& name) {
    return std::any_of(workers_.begin(), workers_.end(),
                       [&](const auto& worker) { return is_given_by(worker.first, name); });
  };
  for (const auto& entry : fs::directory_iterator(settings_.uploads))
    if (const std::string name = entry.path().filename(); name.starts_with(kGiven) && !is_of_worker(name))
      fs::remove(entry.path());
}

}  // namespace saltus::server
