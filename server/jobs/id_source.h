#pragma once

#include "server/jobs/clock.h"

#include <string>

namespace saltus::server {

/// Names and secrets. Thread-safe.
class IdSource {
 public:
  virtual ~IdSource() = default;
  /// Unique; sorts by time as text.
  virtual std::string new_job_id(WallTime now) = 0;
  /// 256 random bits as text: the authority of one attempt.
  virtual std::string new_token() = 0;
  /// A one-way image of `text` that may be stored.
  virtual std::string fingerprint(const std::string& text) const = 0;
};

}  // namespace saltus::server
