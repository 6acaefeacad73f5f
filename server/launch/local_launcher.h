#pragma once

#include "server/jobs/launcher.h"
#include "server/launch/memory_kills.h"

#include <sys/types.h>

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace saltus::server {

struct LocalLauncherSettings {
  std::filesystem::path worker;     ///< the program
  std::string server_address;       ///< where workers find the daemon
  std::filesystem::path run;        ///< for token files
  std::filesystem::path logs;       ///< for what workers print
  std::filesystem::path work;       ///< for a folder of temporary files for each worker; made when missing
  std::filesystem::path blobs{};    ///< where workers find their inputs; empty: these come over the connection
  std::filesystem::path uploads{};  ///< where workers put their results; empty: these go over the connection
  int thread_budget = 0;            ///< threads of all workers together, at most; 0: nobody knows
  std::int64_t max_log_bytes = 1 << 20;
  std::size_t max_logs = 64;  ///< the oldest go first
  /// Of the daemon and its workers together, since ever; see there.
  std::function<std::optional<std::int64_t>()> count_memory_kills = [] { return memory_kills(); };
};

/// Workers as processes on this machine, each in a process group of its own that is ended with it. The token goes
/// through a file that only the owner can read: arguments and environment are visible to others. What a worker prints
/// goes to a file that is emptied when it grows too long, and removed when the worker ends well; of the others the
/// newest are kept. Temporary files of a worker go with it.
///
/// A worker outlives the launcher, so that a restarted daemon can adopt it.
class LocalLauncher final : public Launcher {
 public:
  explicit LocalLauncher(LocalLauncherSettings settings);
  ~LocalLauncher() override;

  void on_exit(ExitHandler handler) override;
  std::string start(const LaunchRequest& request) override;
  bool adopt(const AttemptKey& key, const std::string& process) override;
  void terminate(const AttemptKey& key) override;
  void kill(const AttemptKey& key) override;
  bool is_idle() const override;

  /// To be set before the first start: a port is only known after listening.
  void set_server_address(const std::string& address);
  /// Removes the tokens and temporary files of workers that are neither started nor adopted.
  void remove_stale_files();

 private:
  struct Worker;
  std::string start_process(const LaunchRequest& request);
  bool has_cores_alone() const;
  void watch();
  void wake();
  void reap(const AttemptKey& key, Worker& worker);
  void signal(const AttemptKey& key, int number);
  void limit_logs();
  /// A process that was killed just now was killed for want of memory.
  bool was_memory_kill();
  std::filesystem::path token_file(const AttemptKey& key) const;
  std::filesystem::path log_file(const AttemptKey& key) const;
  std::filesystem::path work_folder(const AttemptKey& key) const;
  void remove_files(const AttemptKey& key) const;

  LocalLauncherSettings settings_;
  ExitHandler handler_;
  mutable std::mutex mutex_;
  std::map<AttemptKey, std::shared_ptr<Worker>> workers_;
  bool is_closing_ = false;
  int wake_descriptor_ = -1;
  std::optional<std::int64_t> memory_kills_;  ///< those that a worker's death has been told with, or were there before
  std::thread thread_;
};

}  // namespace saltus::server
