#include "server/rpc/server_info_service.h"

#include "core/registration/options.h"
#include "server/rpc/limits.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/validate_request.h"

#include <limits>

namespace saltus::server {

grpc::ServerUnaryReactor* ServerInfoServiceImpl::GetServerInfo(grpc::CallbackServerContext* context,
                                                               const v1::GetServerInfoRequest*, v1::ServerInfo* info) {
  return answer_now(context, [&] {
    info->set_version(version_);
    for (const Model model : all_models()) info->add_models(to_string(model));
    for (const SimilarityType similarity : all_similarities()) info->add_similarities(to_string(similarity));
    for (const Preset preset : all_presets()) info->add_presets(to_string(preset));
    for (const std::string& format : image_formats()) info->add_formats(format);
    info->set_max_blob_bytes(limits::kBlobBytes);
    info->set_max_message_bytes(limits::kMessageBytes);
    info->set_max_voxels(limits::kVoxels);
    info->set_max_queued_jobs(limits::kQueuedJobs);
    info->set_queued_jobs(jobs_.queued_jobs());
    info->set_running_jobs(jobs_.running_jobs());
    info->set_is_draining(jobs_.is_paused() || jobs_.is_draining());
    info->set_worker_slots(jobs_.slots());
    const int threads = jobs_.budget().threads;
    info->set_thread_budget(threads == std::numeric_limits<int>::max() ? 0 : threads);
    info->set_memory_budget_bytes(jobs_.counts_memory() ? jobs_.budget().memory_bytes : 0);
    info->set_max_batch_jobs(limits::kBatchJobs);
    info->set_max_queued_jobs_of_submitter(limits_.queued_jobs);
    info->set_max_upload_bytes_of_submitter(limits_.upload_bytes);
    info->set_max_upload_streams_of_submitter(limits::kUploadStreamsOfOne);
    info->set_max_download_streams_of_submitter(limits::kDownloadStreamsOfOne);
    info->set_max_watchers_of_submitter(limits::kWatchStreamsOfOne);
  });
}

}  // namespace saltus::server
