#pragma once

#include "server/jobs/budget.h"
#include "server/jobs/clock.h"
#include "server/jobs/job.h"

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

namespace saltus::server {

/// What has to be known of a queued job to choose the next one.
struct WaitingJob {
  std::string id;
  std::string submitter;
  std::int64_t sequence = 0;
  int priority = kDefaultPriority;
  Demand demand;
  WallTime created{};
  SteadyTime ready{};  ///< not to be started before: the delay of a retry
  int attempt = 0;     ///< of the last one there was
};

/// Whether a job can be started by whoever asks.
enum class Fit {
  Yes,
  NotNow,   ///< there is no room for it at the moment: it is being overtaken
  NotHere,  ///< it is not for this one, and waits for another
};

struct FairnessRules {
  /// A job that has waited this long counts one priority higher, after twice as long two: so none waits for ever.
  std::chrono::milliseconds promotion = std::chrono::minutes(30);
  /// A job that does not fit into what is free lets at most so many later ones start before it; then all wait for it.
  int most_overtakes = 8;
  /// How many jobs that do not fit are looked at before the search for one that does is given up.
  int look_ahead = 100;
};

/// The queued jobs in the order in which they are to be started. Higher priorities first; within a priority the
/// submitters take turns, one job each, whoever has waited longest for a turn first; within a submitter the older job
/// first.
///
/// Has no lock and no clock of its own. put() and remove() find their place in logarithmic time and move what is behind
/// it in the submitter's row; next() and position() go through the submitters.
class WaitingList {
 public:
  explicit WaitingList(FairnessRules rules = {}) : rules_(rules) {}

  /// Adds the job, or changes what is known of it.
  void put(const WaitingJob& job);
  /// Nothing happens when it does not wait.
  void remove(const std::string& id);
  int size() const { return static_cast<int>(jobs_.size()); }

  /// The job to start now: the first that is ready and for which `fits` says yes. `fits` must have no side effect.
  std::optional<WaitingJob> next(WallTime now, SteadyTime steady, const std::function<Fit(const Demand&)>& fits);
  /// This submitter had a turn, after all that are known: for what was started before this list was made.
  void had_turn(const std::string& submitter, int priority);
  /// `id` has been started: its submitter had a turn, and what would have been before it has been overtaken. To be
  /// called with what next() returned, before remove().
  void started(const std::string& id);

  /// 1 is next, as if nothing had to wait for room or the delay of a retry; 0 when the job does not wait.
  int position(const std::string& id, WallTime now);

 private:
  struct Entry {
    WaitingJob job;
    int rank = 0;  ///< priority after promotions
    int overtaken = 0;
  };
  struct Submitter {
    std::vector<std::pair<std::int64_t, std::string>> jobs[kHighestPriority + 1];  ///< by sequence
    std::int64_t turn[kHighestPriority + 1] = {};                                  ///< of the last job started
  };
  void insert(const Entry& entry);
  void take_out(const Entry& entry);
  void promote(WallTime now);
  WallTime promotion_of(const Entry& entry) const;
  /// Calls `visit` in the order of the starts until it says false.
  void in_order(const std::function<bool(Entry&)>& visit);
  std::vector<const Submitter*> by_turn(int rank) const;
  void forget_idle_submitters();

  const FairnessRules rules_;
  std::unordered_map<std::string, Entry> jobs_;
  std::map<std::string, Submitter> submitters_;
  std::set<std::pair<WallTime, std::string>> promotions_;  ///< when each job that can rise does so next
  std::int64_t last_turn_ = 0;
  std::vector<std::string> passed_over_;  ///< by the last next(): those that did not fit
};

}  // namespace saltus::server
