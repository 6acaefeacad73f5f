// Any bytes as a name that comes back to others: what is accepted can be a file's name or be quoted in a log, and is
// found again as it was given. The first byte chooses which name it is.
#include "core/support/errors.h"
#include "server/rpc/roles.h"
#include "server/rpc/validate_request.h"

#include <cctype>
#include <cstdint>
#include <string>

namespace {

using namespace saltus;

const std::string kDigest = "sha256:" + std::string(64, '0');

void require(bool is_kept) {
  if (!is_kept) __builtin_trap();
}

template <class Request>
bool is_accepted(const Request& request) {
  try {
    server::validate(request);
    return true;
  } catch (const InvalidInput& error) {
    const std::string said = error.what();
    // Goes into a header and a terminal, however long and whatever the name was.
    require(!said.empty() && said.size() < 1000);
    for (const char c : said) require(c >= ' ' && c <= '~');
    return false;
  }
}

bool is_plain(const std::string& text, const std::string& more) {
  for (const char c : text)
    if (!(std::isalnum(static_cast<unsigned char>(c)) && static_cast<unsigned char>(c) < 128) &&
        more.find(c) == std::string::npos)
      return false;
  return !text.empty();
}

bool is_printable(const std::string& text) {
  for (const char c : text)
    if (c < ' ' || c > '~') return false;
  return true;
}

v1::CreateRegistrationJobRequest good_job() {
  v1::CreateRegistrationJobRequest request;
  for (v1::InputFile* file : {request.mutable_spec()->mutable_fixed(), request.mutable_spec()->mutable_moving()}) {
    file->set_digest(kDigest);
    file->set_format("mha");
  }
  return request;
}

void try_artifact(const std::string& name) {
  v1::CompleteJobRequest request;
  request.mutable_success()->add_artifacts()->set_name(name);
  request.mutable_success()->mutable_artifacts(0)->set_digest(kDigest);
  if (is_accepted(request)) require(is_plain(name, "._-") && name.front() != '.' && name.size() <= 128);
}

void try_label(const std::string& name) {
  auto request = good_job();
  (*request.mutable_labels())[name] = "value";
  if (is_accepted(request)) require(is_plain(name, "._-") && name.size() <= 128);
}

void try_request_id(const std::string& id) {
  auto request = good_job();
  request.set_request_id(id);
  if (is_accepted(request)) require(is_printable(id) && id.size() <= 36);
}

void try_upload(const std::string& id) {
  v1::QueryWriteStatusRequest request;
  request.set_digest(kDigest);
  request.set_upload_id(id);
  if (is_accepted(request)) require(id.empty() || (is_plain(id, "_-") && id.size() <= 64));
}

void try_digest(const std::string& digest) {
  v1::ReadBlobRequest request;
  request.set_digest(digest);
  if (is_accepted(request)) require(digest.size() == 71 && is_plain(digest, ":"));
}

void try_submitter(const std::string& name) {
  v1::ListRegistrationJobsRequest request;
  request.set_submitter(name);
  if (is_accepted(request)) require(is_printable(name) && name.size() <= 128);
}

void try_job_id(const std::string& id) {
  try {
    server::validate_job_id(id);
    require(is_plain(id, "._-") && id.size() <= 128);
  } catch (const InvalidInput&) {
  }
}

void try_roles(const std::string& text) {
  try {
    for (const auto& [identity, roles] : server::parse_roles(text, "roles")) {
      require(!identity.empty() && !roles.empty());
      require(identity != server::kLocalIdentity);
    }
  } catch (const InvalidInput& error) {
    require(*error.what() != '\0');
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr void (*tries[])(const std::string&) = {try_artifact, try_label,     try_request_id, try_upload,
                                                   try_digest,   try_submitter, try_job_id,     try_roles};
  if (size == 0) return 0;
  tries[data[0] % std::size(tries)](std::string(reinterpret_cast<const char*>(data) + 1, size - 1));
  return 0;
}
