#pragma once

#include "server/jobs/clock.h"

#include <chrono>
#include <deque>
#include <optional>
#include <vector>

namespace saltus::server {

/// How long jobs take, from the last ones that succeeded. Has no lock of its own.
class RecentDurations {
 public:
  void add(std::chrono::milliseconds duration);
  /// The median; nothing while none is known.
  std::optional<std::chrono::milliseconds> typical() const;

 private:
  std::deque<std::chrono::milliseconds> durations_;
};

/// When the job at `position` (1 is next) will start if every job takes `typical` and `places` run at a time, of which
/// `running` began when they did.
WallTime estimate_start(int position, std::vector<WallTime> running, int places, std::chrono::milliseconds typical,
                        WallTime now);

}  // namespace saltus::server
