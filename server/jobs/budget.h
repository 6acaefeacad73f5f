#pragma once

#include "server/jobs/job.h"

#include <cstdint>
#include <map>
#include <string>

namespace saltus::server {

/// What an attempt occupies of the machine.
struct Demand {
  int threads = 1;
  std::int64_t memory_bytes = 0;
  bool operator==(const Demand&) const = default;
};

/// Such as "1.5 GiB", rounded up to a tenth.
std::string gibibytes(std::int64_t bytes);

/// What the daemon may give to workers, and what they hold of it. An attempt that was ended because its worker did not
/// answer holds its share until the process is gone. Has no lock of its own.
class Budget {
 public:
  /// With no slots, nothing fits.
  Budget(int slots, Demand total) : slots_(slots), total_(total) {}

  /// There is room for one more worker of this demand. One that is larger than all there is (the budget was larger when
  /// the job was accepted) fits when nothing else runs.
  bool fits(const Demand& demand) const;
  /// It could never run beside its own daemon: `demand` is larger than all there is.
  bool is_too_large(const Demand& demand) const;
  const Demand& total() const { return total_; }

  void take(const AttemptKey& key, const Demand& demand);
  /// A process exists that will be reported when it ends.
  void has_process(const AttemptKey& key);
  /// The attempt is over. When its process is still to be ended by force, its share stays until exited().
  void ended(const AttemptKey& key, bool by_force);
  void exited(const AttemptKey& key) { held_.erase(key); }

 private:
  struct Share {
    Demand demand;
    bool has_process = false;
  };
  const int slots_;
  const Demand total_;
  std::map<AttemptKey, Share> held_;
};

}  // namespace saltus::server
