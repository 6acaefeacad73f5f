#include "server/daemon.h"

#include "server/config/socket_file.h"
#include "server/jobs/missing_inputs.h"
#include "server/rpc/limits.h"

#include <limits>
#include <set>

namespace saltus::server {
namespace {

// How late a lease's end or the next step of a cancel may be noticed.
constexpr auto kTick = std::chrono::milliseconds(50);
constexpr auto kCallGrace = std::chrono::milliseconds(500);

}  // namespace

Daemon::Daemon(const DaemonSettings& settings, std::function<void(const std::string&)> on_broken, DaemonParts parts)
    : directory_(settings.data),
      log_(settings.log),
      ping_interval_(settings.ping_interval),
      on_alive_(settings.on_alive),
      clock_(parts.clock ? std::move(parts.clock) : std::make_shared<SystemClock>()),
      disk_(parts.disk ? std::move(parts.disk) : std::make_shared<Disk>()),
      metrics_(settings.version, settings.data),
      audit_(directory_.audit(), *clock_,
             [log = settings.log](const std::string& text) {
               log({LogLine::Level::Error, text});
             }),
      observation_(metrics_, audit_, settings.log),
      storage_([this, on_broken = std::move(on_broken)](const std::string& reason) {
        // Whatever has failed: an answer from now on could be a promise that the disk does not keep.
        if (rows_) rows_->refuse_writes();
        on_broken(reason);
        wake();
      }),
      bytes_({directory_.blobs(), directory_.uploads(), directory_.corrupt()}, storage_, *clock_, settings.reserve, {},
             *disk_),
      stalls_(*clock_, limits::kStalledStream) {
  if (!settings.protected_listen.empty()) require_usable(settings.tls);
  if (!settings.roles.empty()) roles_ = std::make_shared<RolesFile>(settings.roles, settings.log);
  directory_.require_database_of_blobs();
  auto store = std::make_unique<SqliteJobStore>(directory_.database(),
                                                [this](const std::string& reason) { storage_.fail(reason); });
  rows_ = store.get();
  store->on_commit([this](auto time, std::size_t writes) { metrics_.committed(time, writes); });
  const auto known = store->blobs();
  const std::set<std::string> known_digests(known.begin(), known.end());
  bytes_.take_back_unknown([&](const std::string& digest) { return known_digests.contains(digest); });
  store_ = std::move(store);
  if (parts.wrap_store) store_ = parts.wrap_store(std::move(store_));

  blobs_ = std::make_unique<BlobCatalog>(*store_, bytes_, *clock_);
  launcher_ = parts.launcher ? std::move(parts.launcher) : make_launcher(settings);
  jobs_ = std::make_unique<JobManager>(
      *store_, *blobs_, *launcher_, *clock_, ids_, settings.jobs, [this] { wake(); }, settings.log);
  if (const int failed = fail_jobs_without_inputs(*rows_, bytes_, *clock_); failed > 0)
    settings.log(std::to_string(failed) + " queued jobs have failed, because the disk has lost their inputs");
  rows_->read([this](JobReader& reader) {
    for (const JobState state : {JobState::Queued, JobState::Running, JobState::Cancelling})
      for (const JobRecord& job :
           reader.list({state}, std::numeric_limits<std::int64_t>::max(), std::numeric_limits<int>::max()))
        observation_.found(job);
  });
  jobs_->watchers().observe([this](const JobRecord& job) { observation_.job_changed(job); },
                            [this](const std::string& id) { observation_.job_deleted(id); });
  jobs_->recover();
  maintenance_ =
      std::make_unique<Maintenance>(*store_, bytes_, *clock_, settings.retention, settings.maintenance, settings.log);
  if (local_) local_->remove_stale_files();
  ListenAddress listen = settings.listen;
  const bool is_socket = listen.kind == ListenAddress::Kind::UnixSocket;
  if (is_socket) require_nobody_listens(listen.path);
  RpcSettings rpc{listen.to_text(), {},
                  settings.tls,     roles_,
                  settings.version, {settings.jobs.queue.max_queued_of_submitter, settings.upload_quota},
                  &observation_};
  for (const ListenAddress& address : settings.protected_listen) rpc.protected_addresses.push_back(address.to_text());
  rpc_ = std::make_unique<RpcServer>(rpc, *jobs_, *blobs_, *maintenance_, stalls_, ids_);
  if (is_socket) restrict_socket(listen.path);
  if (!is_socket) listen.port = rpc_->port();
  address_ = listen.to_text();
  for (std::size_t i = 0; i < settings.protected_listen.size(); ++i) {
    ListenAddress address = settings.protected_listen[i];
    address.port = rpc_->protected_ports()[i];
    protected_addresses_.push_back(address.to_text());
  }
  if (local_) local_->set_server_address(address_);
  if (slurm_) {
    const std::string& told = settings.slurm->batch.server_address;
    const std::string& found = protected_addresses_.empty() ? address_ : protected_addresses_.front();
    slurm_->set_server_address(told.empty() ? found : told);
  }
  metrics_.at_scrape([this, dropped_log_lines = settings.dropped_log_lines] {
    JobReader::Totals blobs;
    rows_->read([&](JobReader& reader) { blobs = reader.blob_totals(); });
    const JobManager::Use workers = jobs_->use_of_workers();
    return std::vector<Metrics::Gauge>{
        {"saltusd_blobs", "Blobs that are stored", static_cast<double>(blobs.count)},
        {"saltusd_blob_bytes", "Bytes of these", static_cast<double>(blobs.bytes)},
        {"saltusd_worker_memory_bytes", "Memory of all running workers", static_cast<double>(workers.memory_bytes)},
        {"saltusd_worker_cpu_seconds", "Processor time of all running workers, in their attempts", workers.cpu_seconds},
        {"saltusd_log_lines_dropped", "Log lines that are missing, because nobody has read them in time",
         static_cast<double>(dropped_log_lines())}};
  });
  if (settings.metrics_port >= 0) metrics_port_ = metrics_.serve(settings.metrics_host, settings.metrics_port);
  thread_ = std::thread([this] { run(); });
}

std::unique_ptr<Launcher> Daemon::make_launcher(const DaemonSettings& settings) {
  if (!settings.slurm) {
    auto made = std::make_unique<LocalLauncher>(LocalLauncherSettings{
        settings.worker, settings.listen.to_text(), directory_.run(), directory_.logs(), directory_.work(),
        directory_.blobs(), directory_.uploads(), settings.jobs.thread_budget});
    local_ = made.get();
    return made;
  }
  SlurmSettings slurm = *settings.slurm;
  slurm.tag = tag_of(directory_.slurm_tag(), ids_.new_token().substr(0, 8));
  slurm.run = directory_.run();
  slurm.logs = directory_.logs();
  slurm.log = settings.log;
  auto made = std::make_unique<SlurmLauncher>(std::move(slurm), clock_);
  slurm_ = made.get();
  return made;
}

Daemon::~Daemon() {
  metrics_.at_scrape(nullptr);
  {
    std::lock_guard lock(mutex_);
    is_closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
  rpc_.reset();
}

void Daemon::wake() {
  {
    std::lock_guard lock(mutex_);
    has_work_ = true;
  }
  changed_.notify_all();
}

void Daemon::watch_reserve() {
  std::string problem;
  try {
    bytes_.require_room();
  } catch (const std::exception& error) {
    problem = error.what();
  }
  if (problem == reserve_problem_) return;
  reserve_problem_ = problem;
  if (problem.empty())
    log_("there is room on the disk again: uploads and new jobs are taken");
  else
    log_({LogLine::Level::Warning, "uploads and new jobs are refused for as long as " + problem});
}

void Daemon::run() {
  SteadyTime next_ping = clock_->steady();
  std::unique_lock lock(mutex_);
  while (!is_closing_) {
    changed_.wait_for(lock, kTick, [this] { return has_work_ || is_closing_; });
    has_work_ = false;
    lock.unlock();
    jobs_->tick();
    if (slurm_) slurm_->want_pilots(jobs_->is_paused() ? 0 : jobs_->queued_jobs());
    if (roles_) roles_->reload_if_changed();
    if (const auto now = clock_->steady(); now >= next_ping) {
      next_ping = now + ping_interval_;
      rpc_->ping([this](auto time) {
        metrics_.pinged(time);
        on_alive_();
      });
    }
    stalls_.cut();
    watch_reserve();
    if (storage_.has_failed() && !is_read_only_) {
      is_read_only_ = true;
      rpc_->set_read_only();
    }
    const bool is_drained = jobs_->is_drained();
    lock.lock();
    if (is_drained && !is_drained_) {
      is_drained_ = true;
      changed_.notify_all();
    }
  }
}

void Daemon::stop() {
  rpc_->set_not_serving();
  jobs_->begin_drain();
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return is_drained_; });
  }
  rpc_->stop(kCallGrace);
}

}  // namespace saltus::server
