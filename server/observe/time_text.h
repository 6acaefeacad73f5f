#pragma once

#include "server/jobs/clock.h"

#include <string>

namespace saltus::server {

/// "2026-01-31T12:00:00.000Z"
std::string utc_text(WallTime time);

}  // namespace saltus::server
