// Any bytes as a message of a stranger: what can be parsed is either accepted or refused with a sentence.
#include "core/support/errors.h"
#include "server/jobs/refusal.h"
#include "server/rpc/validate_request.h"

#include <cstdint>
#include <string>

namespace {

template <class Request>
void check(const std::uint8_t* data, std::size_t size) {
  Request request;
  if (!request.ParseFromArray(data, static_cast<int>(size))) return;
  try {
    saltus::server::validate(request);
  } catch (const saltus::InvalidInput& error) {
    if (std::string(error.what()).empty()) __builtin_trap();
  } catch (const saltus::server::Refusal& refusal) {
    if (std::string(refusal.what()).empty()) __builtin_trap();
  }
}

void check_id(const std::uint8_t* data, std::size_t size) {
  try {
    saltus::server::validate_job_id(std::string(reinterpret_cast<const char*>(data), size));
  } catch (const saltus::InvalidInput&) {
  }
}

void check_upload(const std::uint8_t* data, std::size_t size) {
  saltus::v1::WriteBlobRequest first;
  if (!first.ParseFromArray(data, static_cast<int>(size))) return;
  try {
    saltus::server::validate_upload(first);
  } catch (const saltus::InvalidInput&) {
  } catch (const saltus::server::Refusal&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::uint8_t choice = *data++;
  --size;
  switch (choice % 8) {
    case 0:
      check<saltus::v1::CreateRegistrationJobRequest>(data, size);
      break;
    case 1:
      check<saltus::v1::FindMissingBlobsRequest>(data, size);
      break;
    case 2:
      check<saltus::v1::ReadBlobRequest>(data, size);
      break;
    case 3:
      check<saltus::v1::CompleteJobRequest>(data, size);
      break;
    case 4:
      check<saltus::v1::PutCheckpointRequest>(data, size);
      break;
    case 5:
      check<saltus::v1::QueryWriteStatusRequest>(data, size);
      break;
    case 6:
      check_upload(data, size);
      break;
    default:
      check_id(data, size);
  }
  return 0;
}
