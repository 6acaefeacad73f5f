#pragma once

#include "tests/crash/places.h"
#include "tests/crash/power_cut.h"
#include "tests/crash/traffic.h"
#include "tests/support/child_process.h"

#include <atomic>
#include <deque>
#include <filesystem>
#include <iosfwd>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <vector>

namespace saltus::crash {

/// A daemon, its clients, and the cycles of traffic and death. A breach of a promise is thrown as Violation.
class Harness {
 public:
  /// `programs` is where `saltusd-failpoints` and the workers are.
  Harness(std::filesystem::path programs, unsigned seed);
  ~Harness();

  /// Ends in peace: every job has come to its end. The data folder goes only when all is well.
  void run(int cycles);

  /// Cycle, plan and folder, for whoever looks for the cause of a breach.
  std::string where() const;
  void summarise(std::ostream& out) const;

 private:
  /// What is to happen in one cycle.
  struct Plan {
    std::optional<Places::Choice> place;  ///< nothing: at random
    bool is_orderly = false;              ///< by SIGTERM, while all clients are busy
    int actions_before_end = 0;           ///< of all clients together; 0: the end is not at random
    bool is_armed_from_start = false;
    bool kills_worker = false;
    bool cuts_power = false;
    bool checks_blobs = false;
    bool collects = false;
    int days = 0;  ///< that pass before it
    std::string text;
  };

  int random_below(int count) { return std::uniform_int_distribution<int>(0, count - 1)(generator_); }
  void make_clients(unsigned seed);
  void start(const std::map<std::string, std::string>& environment);
  /// The daemon's promises after a restart. False when it has gone meanwhile.
  bool check();
  Plan make_plan();
  void run_cycle();
  void traffic(const Plan& plan);
  void end_daemon(const Plan& plan);
  void count_deaths(const Plan& plan);
  void kill_random_worker();
  void cut_power_here();
  void come_to_rest();
  void rest();
  void stop_in_order();
  /// Lets days pass and garbage be collected, until nothing is left. Throws Violation when something is left, or goes
  /// that is still needed.
  void clear();
  /// After some days garbage is collected.
  void collect_after(int days);
  void check_what_is_needed();
  /// Returns the inputs of the jobs that are gone since the last time.
  std::set<std::string> observe_all(const std::vector<v1::RegistrationJob>& listed);
  void kill_daemon();
  static void end_orphans();

  const std::filesystem::path programs_;
  std::filesystem::path folder_, armed_, once_, deaths_record_, disk_record_, synced_copies_;
  std::mt19937 generator_;
  std::deque<Traffic> clients_;
  std::optional<testing_support::ChildProcess> daemon_;
  std::string address_;
  int cycle_ = 0;
  std::string plan_text_;

  Places places_;
  int deaths_ = 0, kills_ = 0, stops_ = 0, worker_kills_ = 0, cuts_ = 0, checks_ = 0;
  Losses losses_;
  v1::CollectGarbageResponse collected_;  ///< beside what clients have collected
};

}  // namespace saltus::crash
