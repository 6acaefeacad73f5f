#include "server/config/slurm_options.h"

#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <map>

namespace saltus::server {
namespace {

bool is_every_address(const std::string& host) { return host == "0.0.0.0" || host == "[::]" || host == "*"; }

bool is_this_machine(const std::string& address) {
  const std::string host = address.substr(0, address.rfind(':'));
  return address.starts_with("unix:") || host == "127.0.0.1" || host == "localhost" || host == "[::1]";
}

}  // namespace

void add_slurm_options(CLI::App& app, LauncherKind& launcher, SlurmConfig& config) {
  app.add_option("--launcher", launcher,
                 "Where workers run: local, on this machine, or slurm, as jobs that this daemon submits with sbatch")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, LauncherKind>{{"local", LauncherKind::Local}, {"slurm", LauncherKind::Slurm}}))
      ->default_str("local");
  app.add_option("--slurm-server", config.server,
                 "Where workers in Slurm find this daemon: host:port [the first address with mutual TLS; without any, "
                 "that of this machine, for a Slurm of this machine alone]")
      ->type_name("ADDRESS");
  app.add_option("--slurm-tls-ca", config.authority,
                 "Authority of this daemon's certificate, PEM, as the nodes name the file; like the next two")
      ->type_name("FILE");
  app.add_option("--slurm-tls-cert", config.certificate, "Certificate of workers in Slurm, with the role worker, PEM")
      ->type_name("FILE");
  app.add_option("--slurm-tls-key", config.key, "The private key of --slurm-tls-cert, PEM")->type_name("FILE");
  app.add_option("--slurm-worker", config.worker, "saltus-worker, as the nodes name it [--worker]")->type_name("PATH");
  app.add_option(
         "--slurm-option", config.options,
         "More for sbatch, as --slurm-option=--partition=long; may be repeated, and goes before what the daemon "
         "says")
      ->type_name("OPTION")
      ->take_all();
  app.add_option("--slurm-shared-data", config.shared_data,
                 "The folder of --data, as the nodes name it when they see it: tokens and the workers' logs are then "
                 "there, and inputs are read there [none: all of it goes over the connection]")
      ->type_name("DIR");
  app.add_option("--slurm-pilots", config.pilots,
                 "For many short jobs: submit arrays of workers that do one job after the other, at most so many, with "
                 "--threads-per-job threads each, instead of a job of Slurm for each attempt; 0 does not")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  app.add_option("--slurm-pilot-memory", config.pilot_memory_gib,
                 "Memory of each of them, GiB; a job that needs more is refused")
      ->check(CLI::Range(0.001, 1048576.0))
      ->capture_default_str();
  app.add_option("--slurm-pilot-idle-seconds", config.pilot_idle_seconds, "One ends after so long without a job")
      ->check(CLI::Range(1, 86400))
      ->capture_default_str();
  app.add_option("--slurm-patience-seconds", config.patience_seconds,
                 "How long what sbatch refuses is submitted again, and what Slurm says can never start is left waiting")
      ->check(CLI::Range(0.0, 31536000.0))
      ->capture_default_str();
  app.add_option("--slurm-poll-seconds", config.poll_seconds, "Between two looks at Slurm's queue")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
}

void require_usable(const SlurmConfig& config, const std::vector<ListenAddress>& protected_listen) {
  for (const std::string& option : config.options)
    if (!option.starts_with("--"))
      throw InvalidInput("--slurm-option is " + option + "; it must be a long option of sbatch, as --partition=long");
  if (config.server.empty() && !protected_listen.empty() && is_every_address(protected_listen.front().host))
    throw InvalidInput("--listen is " + protected_listen.front().to_text() +
                       ", which is no name by which nodes find this machine; add --slurm-server HOST:PORT");
  const std::string server =
      !config.server.empty() || protected_listen.empty() ? config.server : protected_listen.front().to_text();
  const bool has_all = !config.authority.empty() && !config.certificate.empty() && !config.key.empty();
  const bool has_any = !config.authority.empty() || !config.certificate.empty() || !config.key.empty();
  const bool needs_tls = !server.empty() && (!is_this_machine(server) || config.server.empty());
  if (has_any != has_all || (needs_tls && !has_all))
    throw InvalidInput(
        "workers in Slurm need --slurm-tls-ca, --slurm-tls-cert and --slurm-tls-key for a port with mutual TLS; give "
        "all "
        "three");
}

}  // namespace saltus::server
