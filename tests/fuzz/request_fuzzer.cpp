// Any bytes as the request of any method: what can be parsed is either refused with a sentence, or accepted and then
// taken into the queue's types. The first byte chooses the method. Methods come from the descriptors, so that a new one
// is tried too; one whose request has fields and that nothing here looks at ends the fuzzer at its start.
#include "core/support/errors.h"
#include "server/jobs/refusal.h"
#include "server/rpc/convert.h"
#include "server/rpc/validate_request.h"

#include "saltus/v1/admin.pb.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace {

using namespace saltus;
using google::protobuf::Message;
using Check = std::function<void(const Message&)>;

void require(bool is_kept, const char* promise) {
  if (is_kept) return;
  std::fprintf(stderr, "broken: %s\n", promise);
  std::abort();
}

template <class Request>
std::pair<std::string, Check> check(void (*look)(const Request&)) {
  return {std::string(Request::descriptor()->full_name()),
          [look](const Message& message) { look(static_cast<const Request&>(message)); }};
}

template <class Request>
std::pair<std::string, Check> check_id() {
  return check<Request>([](const Request& request) { server::validate_job_id(request.id()); });
}

void take(const v1::CreateRegistrationJobRequest& request) {
  server::validate(request);
  std::string content, again;
  const server::NewJob job = server::from_message(request, content);
  v1::RegistrationSpec spec;
  require(spec.ParseFromString(job.spec), "an accepted specification can be read back");
  v1::CreateRegistrationJobRequest copy;
  require(copy.ParseFromString(content), "an accepted request can be read back");
  copy.set_request_id(request.request_id());
  server::from_message(copy, again);
  require(content == again, "the same request gives the same fingerprint");
  require(job.inputs.size() >= 2 && job.inputs.size() <= 6, "a job has its images");
}

/// By the request's name. What a worker says of itself in acquire and heartbeat is compared with its lease only.
const std::map<std::string, Check>& checks() {
  static const std::map<std::string, Check> all{
      check<v1::CreateRegistrationJobRequest>(take),
      check<v1::BatchCreateRegistrationJobsRequest>([](const v1::BatchCreateRegistrationJobsRequest& request) {
        server::validate(request);
        for (const auto& one : request.requests()) take(one);
      }),
      check<v1::ListRegistrationJobsRequest>([](const v1::ListRegistrationJobsRequest& request) {
        server::validate(request);
        server::from_message(request);
      }),
      check_id<v1::GetRegistrationJobRequest>(),
      check_id<v1::CancelRegistrationJobRequest>(),
      check_id<v1::DeleteRegistrationJobRequest>(),
      check_id<v1::WatchRegistrationJobRequest>(),
      check<v1::FindMissingBlobsRequest>(server::validate),
      check<v1::ReadBlobRequest>(server::validate),
      check<v1::WriteBlobRequest>(server::validate_upload),
      check<v1::QueryWriteStatusRequest>(server::validate),
      check<v1::AcquireLeaseRequest>(server::validate),
      check<v1::TakeJobRequest>(server::validate),
      check<v1::ReportExitRequest>([](const v1::ReportExitRequest&) {}),
      check<v1::HeartbeatRequest>(
          [](const v1::HeartbeatRequest& request) { server::to_message(server::from_message(request.progress())); }),
      check<v1::CompleteJobRequest>([](const v1::CompleteJobRequest& request) {
        server::validate(request);
        server::from_message(request);
      }),
      check<v1::PutCheckpointRequest>([](const v1::PutCheckpointRequest& request) {
        server::validate(request);
        server::from_message(request.checkpoint());
      }),
      check<v1::DrainRequest>([](const v1::DrainRequest&) {}),
  };
  return all;
}

struct Method {
  const Message* request;
  Check look;
};

std::vector<Method> all_methods() {
  std::vector<Method> methods;
  for (const auto* file : {v1::RegistrationJob::descriptor()->file(), v1::AcquireLeaseRequest::descriptor()->file(),
                           v1::DrainRequest::descriptor()->file()})
    for (int i = 0; i < file->service_count(); ++i)
      for (int j = 0; j < file->service(i)->method_count(); ++j) {
        const auto* type = file->service(i)->method(j)->input_type();
        const auto found = checks().find(std::string(type->full_name()));
        const bool is_empty = type->field_count() == 0;
        if (found == checks().end() && !is_empty) {
          std::fprintf(stderr, "nothing looks at %s\n", std::string(type->full_name()).c_str());
          std::abort();
        }
        methods.push_back({google::protobuf::MessageFactory::generated_factory()->GetPrototype(type),
                           is_empty ? [](const Message&) {} : found->second});
      }
  return methods;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::vector<Method> methods = all_methods();
  if (size == 0) return 0;
  const Method& method = methods[data[0] % methods.size()];
  const std::unique_ptr<Message> request(method.request->New());
  if (!request->ParseFromArray(data + 1, static_cast<int>(size - 1))) return 0;
  try {
    method.look(*request);
  } catch (const InvalidInput& error) {
    require(*error.what() != '\0', "a refusal has a sentence");
  } catch (const server::Refusal& refusal) {
    require(*refusal.what() != '\0', "a refusal has a sentence");
  }
  return 0;
}
