#pragma once

#include <cstdint>
#include <string_view>

namespace saltus::server {

/// CRC-32C (Castagnoli, reflected polynomial 0x82F63B78, RFC 3720 B.4). About 1 GiB/s.
std::uint32_t crc32c(std::string_view bytes);

}  // namespace saltus::server
