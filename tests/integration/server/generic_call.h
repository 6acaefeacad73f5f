#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/generic/generic_stub.h>

#include <memory>
#include <string>

namespace saltus::testing_support {

struct GenericAnswer {
  grpc::Status status;
  bool is_answered = false;
  std::string bytes;  ///< of the first answer
};

/// Calls a method by its name with one message, waits for the first answer, and hangs up when there may be more.
inline GenericAnswer call_by_name(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                                  const std::string& message, bool hangs_up) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto next = [&] {
    void* tag = nullptr;
    bool is_ok = false;
    return queue.Next(&tag, &is_ok) && is_ok;
  };
  const auto call = stub.PrepareCall(&context, method, &queue);
  call->StartCall(nullptr);
  next();
  const grpc::Slice slice(message);
  call->WriteLast(grpc::ByteBuffer(&slice, 1), {}, nullptr);
  next();
  grpc::ByteBuffer answer;
  call->Read(&answer, nullptr);
  GenericAnswer result;
  result.is_answered = next();
  grpc::Slice whole;
  if (result.is_answered && answer.DumpToSingleSlice(&whole).ok())
    result.bytes.assign(reinterpret_cast<const char*>(whole.begin()), whole.size());
  if (result.is_answered && hangs_up) context.TryCancel();
  call->Finish(&result.status, nullptr);
  next();
  return result;
}

}  // namespace saltus::testing_support
