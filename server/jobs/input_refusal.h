#pragma once

#include "server/jobs/refusal.h"

#include <string>
#include <utility>
#include <vector>

namespace saltus::server {

/// FailedPrecondition INPUT_MISSING: a job names blobs that are not there. Never empty.
class MissingInputs : public Refusal {
 public:
  explicit MissingInputs(std::vector<std::string> digests)
      : Refusal(RefusalKind::FailedPrecondition, "INPUT_MISSING",
                "input " + digests.at(0) + " is not on the server" +
                    (digests.size() > 1 ? ", nor are " + std::to_string(digests.size() - 1) + " others" : "") +
                    "; upload it with WriteBlob first"),
        digests_(std::move(digests)) {}

  const std::vector<std::string>& digests() const { return digests_; }

 private:
  std::vector<std::string> digests_;
};

}  // namespace saltus::server
