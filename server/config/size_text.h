#pragma once

#include "server/store/disk_reserve.h"

#include <cstdint>
#include <string>

namespace saltus::server {

/// "1000000", "512M" or "4G" (MiB, GiB), in bytes. Throws InvalidInput that names `option` for anything else.
std::int64_t parse_size(const std::string& option, const std::string& text);

/// The value of --disk-reserve: a size, or a share of the disk as "10%". Throws InvalidInput for anything else.
ReserveSettings parse_reserve(const std::string& text);

}  // namespace saltus::server
