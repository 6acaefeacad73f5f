#include "core/support/errors.h"
#include "core/support/thread_binding.h"
#include "server/config/config.h"
#include "server/daemon.h"
#include "server/observe/log_output.h"
#include "server/observe/service_manager.h"
#include "server/offline_fsck.h"
#include "server/rpc/limits.h"
#include "server/rpc/status_map.h"

#include <poll.h>
#include <signal.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <memory>

namespace {

using namespace saltus;
using namespace saltus::server;

constexpr int kFailed = 1;
constexpr int kUsage = 2;

/// Signals are read from a descriptor; to be called before any thread is made, so that none takes them.
int take_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGHUP);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  signal(SIGPIPE, SIG_IGN);
  signal(SIGXFSZ, SIG_IGN);  // a file that may not grow further is a write that fails
  return signalfd(-1, &signals, SFD_CLOEXEC);
}

/// Discards input. False when it has ended.
bool stdin_is_open() {
  char bytes[256];
  const ssize_t count = ::read(STDIN_FILENO, bytes, sizeof bytes);
  return count > 0 || (count < 0 && (errno == EINTR || errno == EAGAIN));
}

void wait_for_end(int signals, bool watch_stdin) {
  pollfd polled[] = {{signals, POLLIN, 0}, {watch_stdin ? STDIN_FILENO : -1, POLLIN, 0}};
  while (true) {
    if (::poll(polled, 2, -1) < 0) continue;
    if (polled[0].revents) return write_log("asked to stop by a signal");
    if (polled[1].revents && !stdin_is_open()) return write_log("standard input has ended");
  }
}

void use_slurm(const Config& config, DaemonSettings& settings) {
  SlurmSettings slurm;
  slurm.batch.worker = config.slurm.worker;
  slurm.batch.server_address = config.slurm.server;
  slurm.batch.tls = {config.slurm.authority, config.slurm.certificate, config.slurm.key};
  slurm.batch.shared_data = config.slurm.shared_data;
  slurm.batch.options = config.slurm.options;
  slurm.refusal_patience = std::chrono::milliseconds(static_cast<long long>(1000 * config.slurm.patience_seconds));
  slurm.poll = std::chrono::milliseconds(static_cast<long long>(1000 * config.slurm.poll_seconds));
  // Slurm tells of an end at the next look: until then, a worker that has done its work is not ended by force.
  settings.jobs.linger = std::max<std::chrono::milliseconds>(settings.jobs.linger, 3 * slurm.poll);
  // A request to end goes through Slurm, which gives a worker some seconds more by itself.
  settings.jobs.cancel_ladder = {std::chrono::milliseconds(2000), std::chrono::milliseconds(15000)};
  if (config.slurm.pilots > 0) {
    slurm.pilots.most = config.slurm.pilots;
    slurm.pilots.threads = config.threads_per_job;
    slurm.pilots.memory_bytes = static_cast<std::int64_t>(config.slurm.pilot_memory_gib * (1 << 30));
    slurm.pilots.idle_seconds = config.slurm.pilot_idle_seconds;
    // All jobs are taken by pilots, so none may need more than one has.
    settings.jobs.slots = 0;
    settings.jobs.thread_budget = slurm.pilots.threads;
    settings.jobs.memory_budget = slurm.pilots.memory_bytes;
  }
  settings.slurm = std::move(slurm);
}

DaemonSettings settings_of(const Config& config) {
  DaemonSettings settings;
  settings.data = config.data;
  settings.listen = config.listen;
  settings.protected_listen = config.protected_listen;
  settings.tls = config.tls;
  settings.roles = config.roles;
  settings.worker = config.worker;
  settings.version = SALTUS_VERSION;
  settings.reserve = config.reserve;
  settings.retention = config.retention;
  settings.log = write_log;
  settings.dropped_log_lines = dropped_log_lines;
  settings.metrics_host = config.metrics_host;
  settings.metrics_port = config.metrics_port;
  settings.jobs.slots = config.slots;
  settings.jobs.default_threads = config.threads_per_job;
  settings.jobs.thread_budget = config.threads;
  settings.jobs.memory_budget = config.memory_budget;
  settings.jobs.lease = config.lease;
  settings.jobs.checkpoint_interval = config.checkpoint_interval;
  settings.jobs.queue.retry_delay = config.retry_delay;
  settings.jobs.stall_timeout = config.stall_timeout;
  if (config.launcher == LauncherKind::Slurm) use_slurm(config, settings);
  settings.jobs.heartbeat_interval =
      std::min<std::chrono::milliseconds>(std::chrono::milliseconds(500), config.lease / 4);
  settings.jobs.queue.max_queued = limits::kQueuedJobs;
  settings.jobs.queue.max_queued_of_submitter = config.queue_per_submitter;
  settings.upload_quota = config.upload_quota;
  return settings;
}

#ifdef SALTUS_FAILPOINTS
/// In the daemon built for tests, what is kept for days comes to its end in time: the environment's SALTUS_DAYS_AHEAD.
class ClockAhead final : public Clock {
 public:
  explicit ClockAhead(int days) : ahead_(std::chrono::days(days)) {}
  WallTime wall() const override { return SystemClock().wall() + ahead_; }
  SteadyTime steady() const override { return SystemClock().steady(); }

 private:
  const std::chrono::milliseconds ahead_;
};
#endif

DaemonParts parts_of_process() {
  DaemonParts parts;
#ifdef SALTUS_FAILPOINTS
  if (const char* days = std::getenv("SALTUS_DAYS_AHEAD")) parts.clock = std::make_shared<ClockAhead>(std::atoi(days));
#endif
  return parts;
}

/// Whoever cannot be told will end the daemon by its own rules; until then it has work to do.
template <class Message>
void tell(const Message& message) {
  try {
    message();
  } catch (const std::exception& error) {
    write_log({LogLine::Level::Warning, error.what()});
  }
}

int serve(const Config& config, const ServiceManager& manager, int signals) {
  std::atomic<bool> is_broken{false};
  const auto on_broken = [&](const std::string& reason) {
    write_log(
        {LogLine::Level::Error, "the disk has failed, so the daemon only reads until it is started again: " + reason});
    is_broken = true;
  };
  DaemonSettings settings = settings_of(config);
  settings.on_alive = [&] { tell([&] { manager.alive(); }); };
  // Several times in the time that is given, so that one answer that is late ends nothing.
  if (manager.watchdog())
    settings.ping_interval = std::clamp(std::chrono::duration_cast<std::chrono::milliseconds>(*manager.watchdog() / 4),
                                        std::chrono::milliseconds(1), settings.ping_interval);
  Daemon daemon(settings, on_broken, parts_of_process());
  write_log("saltusd " SALTUS_VERSION " serves " + daemon.address() + " with " + std::to_string(config.slots) +
            " slots");
  std::printf("listening on %s\n", daemon.address().c_str());
  for (const std::string& address : daemon.protected_addresses())
    std::printf("listening on %s with mutual TLS\n", address.c_str());
  if (daemon.metrics_port() > 0)
    std::printf("metrics on http://%s:%d/metrics\n", config.metrics_host.c_str(), daemon.metrics_port());
  std::fflush(stdout);
  tell([&] { manager.ready("serves " + daemon.address()); });
  wait_for_end(signals, config.exit_on_stdin_close);
  tell([&] { manager.stopping(); });
  daemon.stop();
  write_log("stopped");
  return is_broken ? kFailed : 0;
}

}  // namespace

int main(int argc, char** argv) {
  // Last of all, whichever way this ends.
  const std::unique_ptr<void, void (*)(void*)> log_end(&argc, [](void*) { end_log(); });
  set_fault_log([](const std::string& line) { write_log({LogLine::Level::Error, line}); });
  const int signals = take_signals();
  ::umask(0077);
  try {
    release_thread();
    const ServiceManager manager = ServiceManager::from_environment();
    const ParsedConfig parsed = parse_config(argc, argv);
    std::cout << parsed.config_text;
    if (parsed.has_ended) return parsed.exit_code;
    start_log(parsed.config.log_level, parsed.config.log_format);
    if (parsed.config.fsck) return check_data_folder(parsed.config.data, std::cout) ? 0 : kFailed;
    return serve(parsed.config, manager, signals);
  } catch (const InvalidInput& error) {
    std::fprintf(stderr, "saltusd: %s\n", error.what());
    return kUsage;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "saltusd: %s\n", error.what());
    return kFailed;
  }
}
