#pragma once

#include "server/config/listen_address.h"
#include "server/jobs/blob_catalog.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/maintenance.h"
#include "server/jobs/storage_state.h"
#include "server/launch/local_launcher.h"
#include "server/launch/slurm_launcher.h"
#include "server/observe/audit_log.h"
#include "server/observe/metrics.h"
#include "server/observe/observation.h"
#include "server/rpc/rpc_server.h"
#include "server/rpc/stall_watch.h"
#include "server/store/blob_directory.h"
#include "server/store/data_directory.h"
#include "server/store/random_ids.h"
#include "server/store/sqlite_job_store.h"

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace saltus::server {

struct DaemonSettings {
  std::filesystem::path data;
  ListenAddress listen;  ///< on this machine; workers use it
  std::vector<ListenAddress> protected_listen;
  TlsFiles tls;                  ///< for protected_listen
  std::filesystem::path roles;   ///< "": nobody but local callers has a right
  std::filesystem::path worker;  ///< the worker's program
  /// Workers run in Slurm: what is not filled in (tag, folders, log, address of the daemon) is by the daemon.
  std::optional<SlurmSettings> slurm;
  ManagerSettings jobs;
  ReserveSettings reserve;
  std::int64_t upload_quota = 0;  ///< bytes of blobs that one submitter may have; 0: no limit
  Retention retention;
  Maintenance::Intervals maintenance;
  std::string version;
  std::string metrics_host = "127.0.0.1";
  int metrics_port = -1;  ///< -1: no metrics are served; 0: a port that is free
  std::function<void(const LogLine& line)> log = [](const LogLine&) {};  ///< from any thread
  std::function<std::uint64_t()> dropped_log_lines = [] { return 0; };   ///< so far; from any thread
  std::chrono::milliseconds ping_interval = std::chrono::seconds(5);     ///< between two calls to itself
  /// After each of these calls: the daemon's own thread goes round, and gRPC's threads answer. From any thread.
  std::function<void()> on_alive = [] {};
};

/// What tests replace. The default of each is the real thing.
struct DaemonParts {
  std::unique_ptr<Launcher> launcher;
  std::function<std::unique_ptr<JobStore>(std::unique_ptr<JobStore>)> wrap_store;
  std::shared_ptr<const Clock> clock;
  std::shared_ptr<Disk> disk;
};

/// A running daemon: opens the store, recovers what an earlier one left, listens. Destruction without stop() leaves
/// workers running, like a crash.
class Daemon {
 public:
  /// `on_broken` is called once, from another thread, when the disk has failed and the daemon only reads from then on.
  /// Throws std::runtime_error or InvalidInput.
  Daemon(const DaemonSettings& settings, std::function<void(const std::string& reason)> on_broken,
         DaemonParts parts = {});
  ~Daemon();
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  /// What clients on this machine use as an address; with the port that was chosen.
  const std::string& address() const { return address_; }
  /// The addresses with mutual TLS; with the ports that were chosen.
  const std::vector<std::string>& protected_addresses() const { return protected_addresses_; }
  /// The port of the metrics; 0 when they are not served.
  int metrics_port() const { return metrics_port_; }
  const Metrics& metrics() const { return metrics_; }
  /// Returns when the audit log has all that was answered before.
  void flush_audit() { audit_.flush(); }
  /// Refuses new jobs, ends the workers (their jobs are queued again) and all calls. Blocks.
  void stop();

 private:
  void run();
  void wake();
  std::unique_ptr<Launcher> make_launcher(const DaemonSettings& settings);
  /// Tells the log when the disk's reserve is touched, and when it is whole again.
  void watch_reserve();

  std::string address_;
  std::vector<std::string> protected_addresses_;
  std::shared_ptr<RolesFile> roles_;
  DataDirectory directory_;
  const std::function<void(const LogLine&)> log_;
  const std::chrono::milliseconds ping_interval_;
  const std::function<void()> on_alive_;
  const std::shared_ptr<const Clock> clock_;
  const std::shared_ptr<Disk> disk_;
  Metrics metrics_;
  AuditLog audit_;
  Observation observation_;
  int metrics_port_ = 0;
  RandomIds ids_;
  StorageState storage_;
  BlobDirectory bytes_;
  StallWatch stalls_;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool has_work_ = false;
  bool is_drained_ = false;
  bool is_closing_ = false;
  bool is_read_only_ = false;    // own thread only
  std::string reserve_problem_;  // the same; "": there is room

  // Launcher and store call the manager from their threads until they are gone, so they go first.
  std::unique_ptr<JobManager> jobs_;
  std::unique_ptr<BlobCatalog> blobs_;
  SqliteJobStore* rows_ = nullptr;  // inside store_
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<Launcher> launcher_;
  LocalLauncher* local_ = nullptr;  // inside launcher_, as the next
  SlurmLauncher* slurm_ = nullptr;
  std::unique_ptr<Maintenance> maintenance_;
  std::unique_ptr<RpcServer> rpc_;
  std::thread thread_;
};

}  // namespace saltus::server
