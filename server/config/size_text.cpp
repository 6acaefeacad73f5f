#include "server/config/size_text.h"

#include "core/support/errors.h"

#include <charconv>
#include <optional>
#include <utility>

namespace saltus::server {
namespace {

constexpr std::int64_t kMost = std::int64_t{1} << 20;  // of MiB and GiB: what follows cannot overflow

/// A number that is not negative, and what follows it.
std::optional<std::pair<std::int64_t, std::string>> parse_number(const std::string& text) {
  std::int64_t number = -1;
  const char* end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, number);
  if (parsed.ec != std::errc() || number < 0) return std::nullopt;
  return std::pair(number, std::string(parsed.ptr, end));
}

std::optional<std::int64_t> bytes_of(const std::string& text) {
  const auto parsed = parse_number(text);
  if (!parsed) return std::nullopt;
  const auto& [number, unit] = *parsed;
  if (unit.empty()) return number;
  if (unit == "M" && number <= kMost) return number << 20;
  if (unit == "G" && number <= kMost) return number << 30;
  return std::nullopt;
}

}  // namespace

std::int64_t parse_size(const std::string& option, const std::string& text) {
  if (const auto bytes = bytes_of(text)) return *bytes;
  throw InvalidInput(option + " is '" + text + "'; it must be bytes, MiB as 512M or GiB as 4G");
}

ReserveSettings parse_reserve(const std::string& text) {
  if (const auto bytes = bytes_of(text)) return {0, *bytes};
  const auto share = parse_number(text);
  if (share && share->second == "%" && share->first <= 100) return {static_cast<double>(share->first) / 100, 0};
  throw InvalidInput("--disk-reserve is '" + text + "'; it must be bytes, MiB as 512M, GiB as 4G, or a share as 10%");
}

}  // namespace saltus::server
