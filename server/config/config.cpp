#include "server/config/config.h"

#include "core/support/available_cores.h"
#include "core/support/available_memory.h"
#include "core/support/errors.h"
#include "server/config/config_file.h"
#include "server/config/size_text.h"
#include "server/rpc/limits.h"

#include <CLI/CLI.hpp>

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <map>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

constexpr int kUsage = 2;
constexpr int kSlurmSlots = 100;
constexpr double kGibibyte = 1 << 30;

/// The shortest text that is read as the same number.
std::string text_of(double number) {
  char text[32];
  return {text, std::to_chars(text, std::end(text), number).ptr};
}

fs::path default_worker() { return fs::read_symlink("/proc/self/exe").parent_path() / "saltus-worker"; }

std::chrono::milliseconds milliseconds(double seconds) {
  return std::chrono::milliseconds(static_cast<long long>(seconds * 1000));
}

/// What the daemon, the system and the files that are being read need stays free.
std::int64_t default_memory_budget() { return available_memory() / 10 * 8; }

void require_program(const fs::path& program) {
  if (::access(program.c_str(), X_OK) != 0 || fs::is_directory(program))
    throw InvalidInput("--worker is " + program.string() + ", which is not a program; give the path of saltus-worker");
}

/// Numbers about other people's work are for this machine only: a collector beside the daemon can carry them further.
void read_metrics_address(Config& config, const std::string& text) {
  const auto colon = text.rfind(':');
  const std::string port = colon == std::string::npos ? "" : text.substr(colon + 1);
  config.metrics_host = text.substr(0, colon);
  const bool is_number = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (config.metrics_host != "127.0.0.1" || !is_number || std::stoi(port) > 65535)
    throw InvalidInput("--metrics is " + text + "; it must be 127.0.0.1:port, with port 0 for one that is free");
  config.metrics_port = std::stoi(port);
}

/// Divides what is served into one address for this machine, which workers use too, and those with mutual TLS.
void read_addresses(Config& config, const std::vector<std::string>& listen) {
  const std::pair<const char*, bool> needed[] = {{"--tls-cert", config.tls.certificate.empty()},
                                                 {"--tls-key", config.tls.key.empty()},
                                                 {"--tls-client-ca", config.tls.client_authority.empty()},
                                                 {"--roles", config.roles.empty()}};
  const auto is_missing = [](const auto& option) { return option.second; };
  const bool has_tls = !std::all_of(std::begin(needed), std::end(needed), is_missing);
  if (has_tls)
    if (const auto* missing = std::find_if(std::begin(needed), std::end(needed), is_missing);
        missing != std::end(needed))
      throw InvalidInput(std::string(missing->first) +
                         " is not given; mutual TLS needs --tls-cert, --tls-key, --tls-client-ca and --roles");
  std::vector<ListenAddress> local;
  for (const std::string& text : listen) {
    const auto address = parse_listen_address(text, has_tls ? Transport::MutualTls : Transport::Plain);
    (address.kind == ListenAddress::Kind::Protected ? config.protected_listen : local).push_back(address);
  }
  if (local.size() > 1)
    throw InvalidInput("--listen is " + local[0].to_text() + " and " + local[1].to_text() +
                       "; one address for this machine is enough, more need mutual TLS");
  if (has_tls && config.protected_listen.empty())
    throw InvalidInput("--tls-cert is given, but no port to protect; add --listen HOST:PORT");
  config.listen =
      local.empty() ? parse_listen_address("unix:" + (config.data / "saltusd.sock").string()) : local.front();
}

}  // namespace

ParsedConfig parse_config(int argc, char** argv) {
  CLI::App app("The saltus daemon: accepts registration jobs, keeps them safely and hands them to workers.", "saltusd");
  ParsedConfig parsed;
  Config& config = parsed.config;
  std::string data, worker, roles, metrics;
  std::vector<std::string> listen;
  double lease_seconds = 30, checkpoint_seconds = 30, retry_seconds = 5, stall_seconds = 900, memory_gib = 0;
  config.log_level = "info";
  bool is_printing = false;
  app.set_version_flag("--version", SALTUS_VERSION);
  app.config_formatter(std::make_shared<ConfigFile>(app));
  app.set_config("--config", "", "A file with these options; --print-config shows how it looks")
      ->type_name("FILE")
      ->configurable(false);
  app.add_flag("--print-config", is_printing,
               "Print the configuration as the text of such a file, with every option, what it means and its default")
      ->configurable(false);
  app.add_option("--data", data, "Folder for jobs, images and results; made when missing")->type_name("DIR");
  app.add_option("--listen", listen,
                 "unix:/path, 127.0.0.1:port, or with mutual TLS host:port; port 0 takes a free one; may be repeated "
                 "[unix:DIR/saltusd.sock]")
      ->type_name("ADDRESS")
      ->take_all();
  app.add_option("--tls-cert", config.tls.certificate, "Certificate of this daemon, PEM: turns mutual TLS on for ports")
      ->type_name("FILE");
  app.add_option("--tls-key", config.tls.key, "Private key of --tls-cert, PEM")->type_name("FILE");
  app.add_option("--tls-client-ca", config.tls.client_authority, "Authorities that clients' certificates are of, PEM")
      ->type_name("FILE");
  app.add_option("--roles", roles, "Who may do what: lines of IDENTITY = ROLE, ROLE ...")->type_name("FILE");
  app.add_option("--slots", config.slots,
                 "Workers at the same time; in Slurm, waiting or running; 0 runs none here, for workers of other "
                 "machines that come by themselves [cores / threads per job; in Slurm 100]")
      ->check(CLI::Range(0, 4096));
  app.add_option("--threads-per-job", config.threads_per_job,
                 "Threads of a job that does not say: more end one job sooner, and the queue later")
      ->capture_default_str()
      ->check(CLI::Range(1, 1024));
  app.add_option("--threads", config.threads, "Threads of all workers together [cores, at least what the slots need]")
      ->check(CLI::Range(1, 65536));
  app.add_option("--memory-budget", memory_gib, "Memory of all workers together, GiB [80 % of what there is]")
      ->check(CLI::Range(0.001, 1048576.0));
  app.add_option("--worker", worker, "The worker's program [saltus-worker beside saltusd]")->type_name("PATH");
  add_slurm_options(app, config.launcher, config.slurm);
  app.add_option("--lease-seconds", lease_seconds, "How long a worker may be silent before its job is given to another")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str();
  app.add_option("--checkpoint-seconds", checkpoint_seconds,
                 "At least so long between two checkpoints of a job, from which another worker can go on; 0 makes none")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  long long input_days = 7, result_days = 30, upload_hours = 24;
  app.add_option("--keep-inputs-days", input_days, "How long images that no job refers to are kept")
      ->check(CLI::Range(0, 36500))
      ->capture_default_str();
  app.add_option("--keep-results-days", result_days, "How long jobs and their results are kept after the job's end")
      ->check(CLI::Range(0, 36500))
      ->capture_default_str();
  app.add_option("--keep-uploads-hours", upload_hours, "How long an upload that was cut can be continued")
      ->check(CLI::Range(0, 876000))
      ->capture_default_str();
  app.add_flag(
         "--fsck", config.fsck,
         "Check every blob of a folder that no daemon uses, tell what is damaged, and end: 0 nothing, 1 something")
      ->configurable(false);
  std::string reserve;
  app.add_option(
         "--disk-reserve", reserve,
         "What uploads leave free on the disk: bytes, MiB or GiB as 512M or 4G, or a share as 10% [the larger of "
         "5% and 2G]")
      ->type_name("SIZE");
  app.add_option("--queue-per-submitter", config.queue_per_submitter,
                 "Queued jobs of one submitter who comes over TLS; 0 sets no limit")
      ->check(CLI::Range(0, limits::kQueuedJobs))
      ->capture_default_str();
  std::string upload_quota = "100G";
  app.add_option("--upload-quota", upload_quota,
                 "What one submitter who comes over TLS may have uploaded: bytes, 512M or 4G; 0 sets no limit")
      ->type_name("SIZE")
      ->capture_default_str();
  app.add_option("--retry-seconds", retry_seconds, "Before a lost job is tried again; four times as long the next time")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  app.add_option("--stall-seconds", stall_seconds, "A worker that reports no progress for so long is ended")
      ->check(CLI::Range(1.0, 86400.0))
      ->capture_default_str();
  app.add_option("--log-level", config.log_level, "trace, debug, info, warning, error or off")
      ->check(CLI::IsMember({"trace", "debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  app.add_option("--log-format", config.log_format, "text, or json: one object a line")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, LogFormat>{{"text", LogFormat::Text}, {"json", LogFormat::Json}}))
      ->default_str("text");
  app.add_option("--metrics", metrics, "127.0.0.1:port for Prometheus; port 0 takes a free one [none]")
      ->type_name("ADDRESS");
  app.add_flag("--exit-on-stdin-close", config.exit_on_stdin_close,
               "Stop when standard input ends: a private daemon goes with its client");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    parsed.has_ended = true;
    parsed.exit_code = app.exit(error) == 0 ? 0 : kUsage;
    return parsed;
  }
  const auto has_default = [&](const std::string& option, const std::string& value) {
    app.get_option(option)->default_str(value);
  };
  if (data.empty() && !is_printing)
    throw InvalidInput("--data is not given; name the folder for jobs, images and results");
  config.data = data.empty() ? "/DIR" : fs::absolute(data).lexically_normal();
  config.roles = roles;
  has_default("--listen", "unix:" + (config.data / "saltusd.sock").string());
  read_addresses(config, listen);
  if (!metrics.empty()) read_metrics_address(config, metrics);
  const int cores = available_cores();
  const bool is_local = config.launcher == LauncherKind::Local;
  if (app.get_option("--slots")->count() == 0)
    config.slots = is_local ? std::max(1, cores / config.threads_per_job) : kSlurmSlots;
  has_default("--slots", std::to_string(config.slots));
  // What other machines have is not this daemon's to count, unless it is told to.
  const bool is_counted = is_local && config.slots > 0;
  if (config.threads == 0 && is_counted) config.threads = std::max(cores, config.slots * config.threads_per_job);
  has_default("--threads", config.threads > 0 ? std::to_string(config.threads) : "");
  if (config.threads > 0 && config.threads < config.threads_per_job)
    throw InvalidInput("--threads is " + std::to_string(config.threads) + "; it must be at least " +
                       std::to_string(config.threads_per_job) + ", the threads of one job");
  config.memory_budget = static_cast<std::int64_t>(memory_gib * kGibibyte);
  if (config.memory_budget == 0 && is_counted) config.memory_budget = default_memory_budget();
  has_default("--memory-budget",
              config.memory_budget > 0 ? text_of(static_cast<double>(config.memory_budget) / kGibibyte) : "");
  config.worker = worker.empty() ? default_worker() : fs::absolute(worker);
  has_default("--worker", config.worker.string());
  // Another machine's files cannot be looked at.
  if (!is_printing && is_counted) require_program(config.worker);
  if (config.slurm.worker.empty()) config.slurm.worker = config.worker.string();
  has_default("--slurm-worker", config.slurm.worker);
  if (!is_local) require_usable(config.slurm, config.protected_listen);
  if (!reserve.empty()) config.reserve = parse_reserve(reserve);
  config.upload_quota = parse_size("--upload-quota", upload_quota);
  config.retention = {std::chrono::hours(24 * input_days), std::chrono::hours(24 * result_days),
                      std::chrono::hours(upload_hours)};
  config.lease = milliseconds(lease_seconds);
  config.checkpoint_interval = milliseconds(checkpoint_seconds);
  config.retry_delay = milliseconds(retry_seconds);
  config.stall_timeout = milliseconds(stall_seconds);
  parsed.has_ended = is_printing;
  if (is_printing) parsed.config_text = app.config_to_str();
  return parsed;
}

}  // namespace saltus::server
