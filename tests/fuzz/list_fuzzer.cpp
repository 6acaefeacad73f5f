// Any bytes as conditions and page token of a list. The first two bytes say how many of the others are the conditions;
// the rest is the token.
#include "core/support/errors.h"
#include "server/jobs/refusal.h"
#include "server/rpc/convert.h"
#include "server/rpc/page_token.h"
#include "server/rpc/validate_request.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>

namespace {

using namespace saltus;

/// In place of the daemon's SHA-256: as long, and different for different texts as far as this can tell.
std::string fingerprint_of(const std::string& text) {
  std::ostringstream digits;
  digits << std::hex << std::hash<std::string>{}(text) << std::hash<std::string>{}(text + '.');
  return digits.str();
}

void require(bool is_kept) {
  if (!is_kept) __builtin_trap();
}

bool is_refused(const std::string& token, const std::string& conditions) {
  try {
    server::parse_page_token(token, conditions);
    return false;
  } catch (const server::Refusal& refusal) {
    require(refusal.reason() == "BAD_PAGE_TOKEN");
    return true;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  const std::size_t conditions_size = std::min<std::size_t>(data[0] + 256U * data[1], size - 2);
  const std::string token(reinterpret_cast<const char*>(data) + 2 + conditions_size, size - 2 - conditions_size);
  v1::ListRegistrationJobsRequest request;
  if (!request.ParseFromArray(data + 2, static_cast<int>(conditions_size))) return 0;
  const std::string conditions = fingerprint_of(server::conditions_of(request));

  // What is accepted is what was made, byte by byte.
  if (!token.empty() && !is_refused(token, conditions)) {
    const std::int64_t before = server::parse_page_token(token, conditions);
    require(before > 0 && server::make_page_token(before, conditions) == token);
  }
  require(server::parse_page_token("", conditions) == std::numeric_limits<std::int64_t>::max());
  // The token of this list holds for this list, with any size of page, and for no other.
  const std::string made = server::make_page_token(7 + static_cast<std::int64_t>(size), conditions);
  require(server::parse_page_token(made, conditions) == 7 + static_cast<std::int64_t>(size));
  v1::ListRegistrationJobsRequest other = request;
  other.set_page_size(other.page_size() / 2 + 1);
  other.set_page_token(made);
  require(fingerprint_of(server::conditions_of(other)) == conditions);
  other.set_submitter(other.submitter() + "x");
  require(is_refused(made, fingerprint_of(server::conditions_of(other))));

  try {
    server::validate(request);
    const server::JobFilter filter = server::from_message(request);
    require(filter.labels.size() == static_cast<std::size_t>(request.labels_size()));
    require(filter.submitter == request.submitter());
    require(filter.state.has_value() == (request.state() != v1::JOB_STATE_UNSPECIFIED));
  } catch (const InvalidInput& error) {
    require(*error.what() != '\0');
  }
  return 0;
}
