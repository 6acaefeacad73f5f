#pragma once

#include "server/jobs/id_source.h"

namespace saltus::server {

/// Ids and tokens from the operating system's random numbers; fingerprints are SHA-256.
class RandomIds final : public IdSource {
 public:
  std::string new_job_id(WallTime now) override;
  std::string new_token() override;
  std::string fingerprint(const std::string& text) const override;
};

}  // namespace saltus::server
