#include "server/jobs/waiting_list.h"

#include <algorithm>
#include <utility>

namespace saltus::server {
namespace {

// Turns of submitters who have nothing queued are remembered up to so many submitters.
constexpr std::size_t kRememberedSubmitters = 4096;

std::pair<std::int64_t, std::string> place(const WaitingJob& job) { return {job.sequence, job.id}; }

}  // namespace

WallTime WaitingList::promotion_of(const Entry& entry) const {
  return entry.job.created + rules_.promotion * (entry.rank - entry.job.priority + 1);
}

void WaitingList::insert(const Entry& entry) {
  auto& jobs = submitters_[entry.job.submitter].jobs[entry.rank];
  jobs.insert(std::upper_bound(jobs.begin(), jobs.end(), place(entry.job)), place(entry.job));
  if (entry.rank < kHighestPriority) promotions_.emplace(promotion_of(entry), entry.job.id);
}

void WaitingList::take_out(const Entry& entry) {
  auto& jobs = submitters_.at(entry.job.submitter).jobs[entry.rank];
  jobs.erase(std::lower_bound(jobs.begin(), jobs.end(), place(entry.job)));
  promotions_.erase({promotion_of(entry), entry.job.id});
}

void WaitingList::put(const WaitingJob& job) {
  Entry entry{job, std::clamp(job.priority, kLowestPriority, kHighestPriority)};
  if (const auto known = jobs_.find(job.id); known != jobs_.end()) {
    entry.rank = std::max(entry.rank, known->second.rank);
    entry.overtaken = known->second.overtaken;
    take_out(known->second);
  }
  insert(entry);
  jobs_[job.id] = entry;
}

void WaitingList::remove(const std::string& id) {
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  take_out(found->second);
  jobs_.erase(found);
  if (submitters_.size() > kRememberedSubmitters) forget_idle_submitters();
}

void WaitingList::forget_idle_submitters() {
  std::erase_if(submitters_, [](const auto& entry) {
    return std::all_of(std::begin(entry.second.jobs), std::end(entry.second.jobs),
                       [](const auto& jobs) { return jobs.empty(); });
  });
}

void WaitingList::promote(WallTime now) {
  while (!promotions_.empty() && promotions_.begin()->first <= now) {
    Entry& entry = jobs_.at(promotions_.begin()->second);
    take_out(entry);
    ++entry.rank;
    insert(entry);
  }
}

std::vector<const WaitingList::Submitter*> WaitingList::by_turn(int rank) const {
  std::vector<const Submitter*> found;
  for (const auto& [name, submitter] : submitters_)
    if (!submitter.jobs[rank].empty()) found.push_back(&submitter);
  std::sort(found.begin(), found.end(), [rank](const Submitter* a, const Submitter* b) {
    return std::pair(a->turn[rank], a->jobs[rank].front()) < std::pair(b->turn[rank], b->jobs[rank].front());
  });
  return found;
}

void WaitingList::in_order(const std::function<bool(Entry&)>& visit) {
  for (int rank = kHighestPriority; rank >= kLowestPriority; --rank) {
    auto takers = by_turn(rank);
    for (std::size_t round = 0; !takers.empty(); ++round) {
      std::erase_if(takers, [&](const Submitter* taker) { return taker->jobs[rank].size() <= round; });
      for (const Submitter* taker : takers)
        if (!visit(jobs_.at(taker->jobs[rank][round].second))) return;
    }
  }
}

std::optional<WaitingJob> WaitingList::next(WallTime now, SteadyTime steady,
                                            const std::function<Fit(const Demand&)>& fits) {
  promote(now);
  passed_over_.clear();
  std::optional<WaitingJob> chosen;
  in_order([&](Entry& entry) {
    if (entry.job.ready > steady) return true;
    const Fit fit = fits(entry.job.demand);
    if (fit == Fit::NotHere) return true;
    if (fit == Fit::Yes) {
      chosen = entry.job;
      return false;
    }
    passed_over_.push_back(entry.job.id);
    return entry.overtaken < rules_.most_overtakes && static_cast<int>(passed_over_.size()) < rules_.look_ahead;
  });
  return chosen;
}

void WaitingList::had_turn(const std::string& submitter, int priority) {
  submitters_[submitter].turn[std::clamp(priority, kLowestPriority, kHighestPriority)] = ++last_turn_;
  if (submitters_.size() > kRememberedSubmitters) forget_idle_submitters();
}

void WaitingList::started(const std::string& id) {
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  submitters_.at(found->second.job.submitter).turn[found->second.rank] = ++last_turn_;
  for (const std::string& passed : passed_over_)
    if (const auto entry = jobs_.find(passed); entry != jobs_.end()) ++entry->second.overtaken;
  passed_over_.clear();
}

int WaitingList::position(const std::string& id, WallTime now) {
  promote(now);
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return 0;
  const Entry& entry = found->second;
  std::size_t before = 0;
  for (int rank = kHighestPriority; rank > entry.rank; --rank)
    for (const auto& [name, submitter] : submitters_) before += submitter.jobs[rank].size();

  // In the round of this job, and in all before it, every submitter who still has one starts one.
  const Submitter& own = submitters_.at(entry.job.submitter);
  const auto& jobs = own.jobs[entry.rank];
  const auto round =
      static_cast<std::size_t>(std::lower_bound(jobs.begin(), jobs.end(), place(entry.job)) - jobs.begin());
  bool is_earlier = true;
  for (const Submitter* taker : by_turn(entry.rank)) {
    if (taker == &own) {
      is_earlier = false;
      before += round;
    } else {
      before += std::min(taker->jobs[entry.rank].size(), round + (is_earlier ? 1 : 0));
    }
  }
  return static_cast<int>(before) + 1;
}

}  // namespace saltus::server
