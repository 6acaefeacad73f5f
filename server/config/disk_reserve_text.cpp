#include "server/config/disk_reserve_text.h"

#include "core/support/errors.h"

#include <charconv>

namespace saltus::server {

ReserveSettings parse_reserve(const std::string& text) {
  constexpr std::int64_t kMost = std::int64_t{1} << 20;  // of MiB and GiB: what follows cannot overflow
  std::int64_t number = -1;
  const char* end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, number);
  const std::string unit(parsed.ptr, end);
  const bool is_number = parsed.ec == std::errc() && number >= 0;
  if (is_number && unit.empty()) return {0, number};
  if (is_number && unit == "M" && number <= kMost) return {0, number << 20};
  if (is_number && unit == "G" && number <= kMost) return {0, number << 30};
  if (is_number && unit == "%" && number <= 100) return {static_cast<double>(number) / 100, 0};
  throw InvalidInput("--disk-reserve is '" + text + "'; it must be bytes, MiB as 512M, GiB as 4G, or a share as 10%");
}

}  // namespace saltus::server
