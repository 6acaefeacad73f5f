#include "server/rpc/admin_service.h"

#include "server/rpc/fsck_stream.h"
#include "server/rpc/status_map.h"
#include "server/rpc/unary_call.h"

namespace saltus::server {
namespace {

// Each of them reads the whole store.
constexpr int kChecks = 1;

}  // namespace

AdminServiceImpl::AdminServiceImpl(JobManager& jobs, Maintenance& maintenance, TaskPool& pool, StallWatch& stalls,
                                   std::function<void(bool)> on_drain)
    : jobs_(jobs),
      maintenance_(maintenance),
      pool_(pool),
      stalls_(stalls),
      on_drain_(std::move(on_drain)),
      checks_("fsck", kChecks) {}

grpc::ServerUnaryReactor* AdminServiceImpl::Drain(grpc::CallbackServerContext* context, const v1::DrainRequest* request,
                                                  v1::DrainResponse* response) {
  return answer_now(context, [&] {
    jobs_.set_paused(!request->resume());
    on_drain_(!request->resume());
    response->set_is_draining(!request->resume());
    response->set_running_jobs(jobs_.running_jobs());
    response->set_queued_jobs(jobs_.queued_jobs());
  });
}

grpc::ServerUnaryReactor* AdminServiceImpl::CollectGarbage(grpc::CallbackServerContext* context,
                                                           const v1::CollectGarbageRequest*,
                                                           v1::CollectGarbageResponse* response) {
  auto* reactor = context->DefaultReactor();
  maintenance_.collect([context, reactor, response](std::exception_ptr error, const GarbageReport& report) {
    response->set_jobs(report.jobs);
    response->set_blobs(report.blobs);
    response->set_blob_bytes(report.blob_bytes);
    response->set_uploads(report.uploads);
    response->set_upload_bytes(report.upload_bytes);
    response->set_orphans(report.orphans);
    reactor->Finish(status_of(error, *context));
  });
  return reactor;
}

grpc::ServerWriteReactor<v1::FsckResponse>* AdminServiceImpl::Fsck(grpc::CallbackServerContext* context,
                                                                   const v1::FsckRequest*) {
  return check_store(maintenance_, pool_, checks_, stalls_, *context);
}

}  // namespace saltus::server
