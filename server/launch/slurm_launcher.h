#pragma once

#include "server/jobs/clock.h"
#include "server/jobs/launcher.h"
#include "server/launch/batch_listing.h"
#include "server/launch/batch_script.h"
#include "server/launch/command.h"

#include <condition_variable>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <thread>

namespace saltus::server {

/// Workers that come by themselves, submitted as arrays while jobs wait: for many short jobs, each of which would take
/// Slurm longer to begin than it lasts.
struct PilotSettings {
  int most = 0;  ///< waiting or running in Slurm; 0: none are submitted
  int threads = 1;
  std::int64_t memory_bytes = 0;
  int idle_seconds = 60;  ///< a pilot ends after so long without a job
};

struct SlurmSettings {
  BatchSettings batch;
  std::string tag;             ///< tells the Slurm jobs of this daemon from those of others of the same user
  std::filesystem::path run;   ///< for token files, when the nodes share the data folder
  std::filesystem::path logs;  ///< for what workers print, the same
  PilotSettings pilots;
  std::size_t max_logs = 64;                       ///< the oldest go first
  std::chrono::milliseconds poll{10000};           ///< between two looks at the queue
  std::chrono::milliseconds command_limit{30000};  ///< for sbatch, squeue and scancel to answer
  /// How long a submission that is refused is repeated, and one that can never start is left waiting: whoever runs the
  /// site may be at it.
  std::chrono::milliseconds refusal_patience{600000};
  std::function<void(const std::string& line)> log = [](const std::string&) {};
};

/// Workers as jobs of Slurm, one for each attempt: submitted by sbatch, watched by squeue, taken out by scancel.
///
/// All commands run on one thread, one after the other. Slurm's own queue is the truth: an attempt is known there by
/// the name of its job, which can be told from its key, so that a daemon which is started again finds the jobs of the
/// one before, and one that has submitted without hearing the answer does not submit twice. A job of this daemon's that
/// no attempt knows is cancelled. A controller that does not answer is waited for: nothing is lost or submitted
/// meanwhile, and workers that run go on.
///
/// The token goes through the script to the worker, which keeps it in a file of mode 0600; with a shared data folder it
/// goes through such a file there.
class SlurmLauncher final : public Launcher {
 public:
  /// With `has_thread` false, nothing happens but in step().
  SlurmLauncher(SlurmSettings settings, std::shared_ptr<const Clock> clock, CommandRunner run = run_command,
                bool has_thread = true);
  /// A command that is under way is killed. Slurm's jobs go on.
  ~SlurmLauncher() override;

  bool is_batch_system() const override { return true; }
  std::string name_of(const AttemptKey& key) const override;
  void on_news(NewsHandler handler) override { on_news_ = std::move(handler); }
  void on_exit(ExitHandler handler) override;
  std::string start(const LaunchRequest& request) override;
  bool adopt(const AttemptKey& key, const std::string& process) override;
  void terminate(const AttemptKey& key) override;
  void kill(const AttemptKey& key) override;
  bool is_idle() const override;

  /// So many jobs wait for pilots. Never blocks.
  void want_pilots(int waiting_jobs);

  /// To be set before the first start: a port is only known after listening.
  void set_server_address(const std::string& address);

  /// Does what is due, on the calling thread. Returns when the next is.
  SteadyTime step();

 private:
  struct Attempt {
    enum class Place {
      ToSubmit,   ///< nothing of it is in Slurm
      Uncertain,  ///< sbatch did not say that it took it: Slurm's queue knows
      Submitted,  ///< Slurm has it, or had it
    } place = Place::ToSubmit;
    std::optional<LaunchRequest> request;  ///< nothing for one that an earlier daemon has submitted
    std::string batch_id;
    std::optional<QueueNews> told;          ///< the last news of it
    bool is_unwanted = false;               ///< to be cancelled, until it is gone
    bool is_to_be_killed = false;           ///< and without waiting for its worker
    std::optional<SteadyTime> next_cancel;  ///< when scancel is called again; nothing: now
    bool is_excused = false;                ///< Slurm was not there when it was submitted
    /// Since when sbatch has not taken it, or Slurm says that it can never start.
    std::optional<SteadyTime> refused;
    bool is_hopeless = false;              ///< sbatch said that no node could ever run it
    std::optional<SteadyTime> not_before;  ///< of the next try
    std::string refusal;
  };
  struct Told {
    AttemptKey key;
    std::optional<QueueNews> news;
    std::optional<WorkerExit> exit;
  };
  void work(std::stop_token stop);
  void wake();
  /// True when Slurm answers.
  bool look();
  void reconcile(const std::vector<BatchRow>& rows, SteadyTime now);
  /// Returns how it has ended, if it has.
  std::optional<WorkerExit> follow(const AttemptKey& key, Attempt& attempt, const BatchRow& row, SteadyTime now);
  /// Under the lock. Nothing when it is known already.
  void tell_news(const AttemptKey& key, Attempt& attempt, QueueNews news);
  void cancel_unwanted();
  void scancel(const std::vector<std::string>& ids, bool by_force);
  /// False when there is none to submit, or the answer has to be waited for.
  bool submit_next();
  Command command_for(const LaunchRequest& request);
  void drop_what_was_not_submitted();
  void count_pilots(const std::vector<const BatchRow*>& rows, SteadyTime now);
  void submit_pilots();
  std::string name_of_pilots() const { return "saltus-" + settings_.tag + "-pilots"; }
  void end(const AttemptKey& key, WorkerExit exit);
  void tell();
  void failed(const std::string& command, const CommandResult& result);
  CommandResult run(const Command& command);
  std::filesystem::path token_file(const AttemptKey& key) const;

  SlurmSettings settings_;
  const std::shared_ptr<const Clock> clock_;
  const CommandRunner run_;
  const bool has_thread_;
  ExitHandler on_exit_;
  NewsHandler on_news_ = [](const AttemptKey&, const QueueNews&) {};

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<AttemptKey, Attempt> attempts_;
  std::vector<Told> to_tell_;
  bool has_work_ = false;
  int wanted_ = 0;  ///< jobs that wait for pilots

  // Own thread only.
  SteadyTime next_look_{};
  bool has_looked_ = false;
  bool is_away_ = false;                      ///< Slurm did not answer the last time
  bool is_in_doubt_ = false;                  ///< a submission may have been taken or not
  int pilots_ = 0;                            ///< at the last look, and submitted since
  int pending_pilots_ = 0;                    ///< of these, have not begun
  std::set<std::string> spoiled_pilots_;      ///< ids of those that have ended badly, as far as Slurm still knows them
  std::chrono::milliseconds pilot_pause_{0};  ///< after such a one
  SteadyTime next_pilots_{};
  std::string pilot_reason_;      ///< for which pilots can never start, at the last look; "" when they can
  std::string pilot_refusal_;     ///< the last one, "" when there was none since one was taken
  bool has_strays_ = false;       ///< at the last look
  std::set<std::string> strays_;  ///< ids of jobs of ours that no attempt knows, or knows twice
  std::stop_token stop_;
  std::jthread thread_;
};

/// A name for the Slurm jobs of the daemon that has this folder, made at random once and kept in `file`. Throws
/// std::runtime_error.
std::string tag_of(const std::filesystem::path& file, const std::string& fresh);

}  // namespace saltus::server
