#include "server/rpc/call_interceptor.h"

#include "saltus/v1/registration.pb.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

namespace saltus::server {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using grpc::experimental::InterceptionHookPoints;

constexpr std::string_view kOwnServices = "/saltus.v1.";
constexpr std::string_view kWriteBlob = "/saltus.v1.BlobService/WriteBlob";
constexpr std::string_view kReadBlob = "/saltus.v1.BlobService/ReadBlob";

std::string text_of(const Message& message, const char* field) {
  const FieldDescriptor* found = message.GetDescriptor()->FindFieldByName(field);
  if (!found || found->is_repeated() || found->cpp_type() != FieldDescriptor::CPPTYPE_STRING) return "";
  return message.GetReflection()->GetString(message, found);
}

/// An id or a digest is told as it is; what else a caller may have sent in its place is not, since it could be a name.
bool is_plain(const std::string& text) {
  return !text.empty() && text.size() <= 80 &&
         text.find_first_not_of("0123456789abcdefghijklmnopqrstuvwxyz-:") == std::string::npos;
}

void note_subject(const Message& message, CallRecord& call) {
  for (const char* field : {"id", "job_id"})
    if (const std::string id = text_of(message, field); is_plain(id) && call.jobs.empty()) call.jobs.push_back(id);
  if (const std::string digest = text_of(message, "digest"); call.blob.empty() && is_plain(digest)) call.blob = digest;
  const FieldDescriptor* jobs = message.GetDescriptor()->FindFieldByName("jobs");
  if (!call.is_change || !jobs || !jobs->is_repeated() || jobs->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return;
  for (int i = 0; i < message.GetReflection()->FieldSize(message, jobs); ++i)
    if (const std::string id = text_of(message.GetReflection()->GetRepeatedMessage(message, jobs, i), "id");
        is_plain(id))
      call.jobs.push_back(id);
}

class CallInterceptor final : public grpc::experimental::Interceptor {
 public:
  CallInterceptor(const Authorisation& authorisation, CallObserver& observer, grpc::experimental::ServerRpcInfo& info)
      : authorisation_(authorisation), observer_(observer), context_(*info.server_context()) {
    call_.method = info.method();
    call_.code = "CANCELLED";  // unless a status is sent
    const MethodRule* rule = find_rule(call_.method);
    call_.is_change = rule && rule->is_change;
    is_own_ = call_.method.starts_with(kOwnServices);
  }

  ~CallInterceptor() override {
    if (!has_begun_) return;
    call_.time = std::chrono::steady_clock::now() - began_;
    observer_.ended(call_);
  }

  void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_INITIAL_METADATA)) begin();
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE))
      received(methods->GetRecvMessage());
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_MESSAGE)) sent(methods->GetSendMessage());
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS))
      call_.code = to_string(methods->GetSendStatus().error_code());
    methods->Proceed();
  }

 private:
  void begin() {
    if (context_.peer().starts_with("inproc")) return;
    const Caller caller = authorisation_.caller_of(context_);
    call_.identity = caller.identity;
    call_.is_local = caller.is_local;
    has_begun_ = true;
    observer_.began(call_.method);
  }

  // The pointers are those of the generated messages, which have Message as their only base; other people's services
  // (health, reflection) may have other types there.
  void received(const void* message) {
    if (!is_own_ || !message) return;
    note_subject(*static_cast<const Message*>(message), call_);
    if (call_.method == kWriteBlob)
      observer_.received_blob_bytes(static_cast<const v1::WriteBlobRequest*>(message)->data().size());
  }
  void sent(const void* message) {
    if (!is_own_ || !message) return;
    if (call_.is_change) note_subject(*static_cast<const Message*>(message), call_);
    if (call_.method == kReadBlob)
      observer_.sent_blob_bytes(static_cast<const v1::ReadBlobResponse*>(message)->data().size());
  }

  const Authorisation& authorisation_;
  CallObserver& observer_;
  grpc::ServerContextBase& context_;
  const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
  CallRecord call_;
  bool is_own_ = false;
  bool has_begun_ = false;
};

class Factory final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  Factory(const Authorisation& authorisation, CallObserver& observer)
      : authorisation_(authorisation), observer_(observer) {}

  grpc::experimental::Interceptor* CreateServerInterceptor(grpc::experimental::ServerRpcInfo* info) override {
    return new CallInterceptor(authorisation_, observer_, *info);
  }

 private:
  const Authorisation& authorisation_;
  CallObserver& observer_;
};

}  // namespace

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> make_call_interceptor(
    const Authorisation& authorisation, CallObserver& observer) {
  return std::make_unique<Factory>(authorisation, observer);
}

std::string to_string(grpc::StatusCode code) {
  constexpr const char* kNames[] = {
      "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
      "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
      "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
      "DATA_LOSS", "UNAUTHENTICATED"};
  const auto number = static_cast<std::size_t>(code);
  return number < std::size(kNames) ? kNames[number] : "UNKNOWN";
}

}  // namespace saltus::server
