#pragma once

#include "server/store/disk_reserve.h"

#include <string>

namespace saltus::server {

/// "1000000", "512M", "4G" (MiB, GiB) or "10%". Throws InvalidInput for anything else.
ReserveSettings parse_reserve(const std::string& text);

}  // namespace saltus::server
