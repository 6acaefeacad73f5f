#include "server/jobs/start_estimate.h"

#include <algorithm>

namespace saltus::server {
namespace {

constexpr std::size_t kRemembered = 32;

}  // namespace

void RecentDurations::add(std::chrono::milliseconds duration) {
  durations_.push_back(duration);
  if (durations_.size() > kRemembered) durations_.pop_front();
}

std::optional<std::chrono::milliseconds> RecentDurations::typical() const {
  if (durations_.empty()) return std::nullopt;
  std::vector<std::chrono::milliseconds> sorted(durations_.begin(), durations_.end());
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

WallTime estimate_start(int position, std::vector<WallTime> running, int places, std::chrono::milliseconds typical,
                        WallTime now) {
  // When each place is free next; one that should have been free already is about to be.
  std::vector<WallTime> is_free;
  for (const WallTime began : running) is_free.push_back(std::max(now, began + typical));
  is_free.resize(std::max({is_free.size(), static_cast<std::size_t>(places), std::size_t{1}}), now);
  std::sort(is_free.begin(), is_free.end());
  const auto ahead = static_cast<std::size_t>(position - 1);
  return is_free[ahead % is_free.size()] + typical * static_cast<std::int64_t>(ahead / is_free.size());
}

}  // namespace saltus::server
