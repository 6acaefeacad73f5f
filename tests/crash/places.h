#pragma once

#include <filesystem>
#include <iosfwd>
#include <map>
#include <random>
#include <string>

namespace saltus::crash {

/// A named place at which a process is killed, see core/support/failpoint.h.
struct Place {
  const char* name;
  int passes;                  ///< how often it is passed in a cycle, about
  bool needs_garbage = false;  ///< passed only when garbage is collected
};

/// Chooses the places, so that all come about as often: some are passed a hundred times a second, others only after
/// much else has happened.
class Places {
 public:
  struct Choice {
    const Place* place = nullptr;
    int pass = 1;  ///< the process is killed when it is there for this time
  };
  /// One of those at which the fewest processes have died.
  Choice choose(std::mt19937& generator);
  /// What came of the choice: how many processes died there.
  void died(const Choice& choice, int processes);

  /// The fewest deaths at any place, and all as "name count".
  int fewest() const;
  void print(std::ostream& out) const;

 private:
  struct Past {
    int deaths = 0;
    bool was_missed = false;  ///< the last time, nobody passed it so often
  };
  std::map<std::string, Past> past_;
};

/// How many processes have died at a named place, by the file that SALTUS_FAILPOINT_RECORD names.
int deaths_in(const std::filesystem::path& record);

}  // namespace saltus::crash
