#include "client/lib/admin_client.h"

#include "client/lib/client_error.h"

namespace saltus::client {

AdminClient::AdminClient(CallSettings settings)
    : settings_(std::move(settings)),
      stub_(v1::AdminService::NewStub(make_channel(settings_.address, settings_.tls))) {}

v1::DrainResponse AdminClient::drain(bool resume) {
  v1::DrainRequest request;
  request.set_resume(resume);
  v1::DrainResponse response;
  call(settings_, CallKind::Unary,
       [&](grpc::ClientContext& context, bool&) { return stub_->Drain(&context, request, &response); });
  return response;
}

v1::CollectGarbageResponse AdminClient::collect_garbage() {
  v1::CollectGarbageResponse response;
  // It lasts as long as there is something to remove.
  call(settings_, CallKind::Stream,
       [&](grpc::ClientContext& context, bool&) { return stub_->CollectGarbage(&context, {}, &response); });
  return response;
}

v1::FsckResponse AdminClient::fsck(const std::function<void(const v1::FsckResponse&)>& told) {
  v1::FsckResponse response;
  bool has_begun = false;
  call(settings_, CallKind::Stream, [&](grpc::ClientContext& context, bool&) {
    const auto reader = stub_->Fsck(&context, {});
    while (reader->Read(&response)) {
      has_begun = true;
      told(response);
    }
    const grpc::Status status = reader->Finish();
    if (has_begun && !status.ok())
      return grpc::Status(grpc::StatusCode::ABORTED, "the check was cut off: " + status.error_message());
    return status;
  });
  return response;
}

}  // namespace saltus::client
