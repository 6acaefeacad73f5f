#include "server/rpc/page_token.h"

#include "server/jobs/refusal.h"

#include <charconv>
#include <limits>

namespace saltus::server {
namespace {

// Enough of a fingerprint to tell one list from another.
constexpr std::size_t kConditionDigits = 16;

}  // namespace

std::string make_page_token(std::int64_t before, const std::string& conditions_fingerprint) {
  return std::to_string(before) + "-" + conditions_fingerprint.substr(0, kConditionDigits);
}

std::int64_t parse_page_token(const std::string& token, const std::string& conditions_fingerprint) {
  if (token.empty()) return std::numeric_limits<std::int64_t>::max();
  std::int64_t before = 0;
  const auto parsed = std::from_chars(token.data(), token.data() + token.size(), before);
  if (parsed.ec == std::errc() && before > 0 && token == make_page_token(before, conditions_fingerprint)) return before;
  throw Refusal(RefusalKind::InvalidArgument, "BAD_PAGE_TOKEN",
                "page_token is not one that a list with these conditions has given; begin again without page_token");
}

}  // namespace saltus::server
