#pragma once

#include "server/config/listen_address.h"
#include "server/config/slurm_options.h"
#include "server/jobs/garbage_collector.h"
#include "server/observe/log_output.h"
#include "server/rpc/listener.h"
#include "server/store/disk_reserve.h"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace saltus::server {

/// What command line and configuration file say.
struct Config {
  std::filesystem::path data;
  ListenAddress listen;  ///< on this machine; workers use it
  std::vector<ListenAddress> protected_listen;
  TlsFiles tls;  ///< set when protected_listen is not empty
  std::filesystem::path roles;
  std::filesystem::path worker;
  LauncherKind launcher = LauncherKind::Local;
  SlurmConfig slurm;
  int slots = 0;  ///< 0: none run on this machine
  int threads_per_job = 1;
  int threads = 0;                 ///< of all workers together; 0: not counted
  std::int64_t memory_budget = 0;  ///< bytes, of all workers together; 0: not counted
  std::chrono::milliseconds lease{};
  std::chrono::milliseconds checkpoint_interval{};
  ReserveSettings reserve;
  int queue_per_submitter = 1000;  ///< queued jobs of one who comes over TLS; 0: no limit
  std::int64_t upload_quota = 0;   ///< bytes of blobs of the same; 0: no limit
  Retention retention;
  bool fsck = false;  ///< check the folder and end
  std::chrono::milliseconds retry_delay{};
  std::chrono::milliseconds stall_timeout{};
  std::string log_level;
  LogFormat log_format = LogFormat::Text;
  std::string metrics_host;
  int metrics_port = -1;  ///< -1: no metrics
  bool exit_on_stdin_close = false;

  bool operator==(const Config&) const = default;
};

struct ParsedConfig {
  Config config;
  bool has_ended = false;   ///< help or version was printed, the usage was wrong, or config_text is wanted: end with
                            ///< exit_code
  std::string config_text;  ///< what --print-config prints
  int exit_code = 0;
};

/// Reads the command line and the file of --config, and fills in what they leave out. Throws InvalidInput.
ParsedConfig parse_config(int argc, char** argv);

}  // namespace saltus::server
