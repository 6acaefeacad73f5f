#include "tests/crash/connection.h"

#include "client/lib/checksum.h"

#include <chrono>

namespace saltus::crash {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds patience{60000};
constexpr milliseconds glance{200};
constexpr std::size_t piece = 50000;  ///< bytes in one message of an upload

void set_deadline(grpc::ClientContext& context, milliseconds time) {
  context.set_deadline(std::chrono::system_clock::now() + time);
}

/// "" or the daemon's reason. What comes without a reason comes from a broken connection.
std::string reason_of(const grpc::Status& status, const grpc::ClientContext& context) {
  if (status.ok()) return "";
  const auto& trailers = context.GetServerTrailingMetadata();
  const auto found = trailers.find("saltus-reason");
  if (found != trailers.end()) {
    const std::string reason(found->second.data(), found->second.size());
    if (reason == "INTERNAL") throw Violation("the daemon has a fault: " + status.error_message());
    if (status.error_code() != grpc::StatusCode::UNAVAILABLE) return reason;
  }
  throw DaemonGone("no answer from the daemon, code " + std::to_string(status.error_code()) + ": " +
                   status.error_message());
}

}  // namespace

std::string digest_of(const std::string& bytes) {
  client::Sha256 sha;
  sha.add(bytes);
  return sha.digest();
}

Connection::Connection(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  const auto channel = grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
  jobs_ = v1::RegistrationService::NewStub(channel);
  blobs_ = v1::BlobService::NewStub(channel);
  admin_ = v1::AdminService::NewStub(channel);
}

std::string Connection::create(const v1::CreateRegistrationJobRequest& request, v1::RegistrationJob& job) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  return reason_of(jobs_->CreateRegistrationJob(&context, request, &job), context);
}

std::string Connection::create_batch(const std::vector<v1::CreateRegistrationJobRequest>& requests,
                                     std::vector<v1::RegistrationJob>& jobs) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::BatchCreateRegistrationJobsRequest batch;
  for (const auto& request : requests) *batch.add_requests() = request;
  v1::BatchCreateRegistrationJobsResponse response;
  const std::string reason = reason_of(jobs_->BatchCreateRegistrationJobs(&context, batch, &response), context);
  jobs.assign(response.jobs().begin(), response.jobs().end());
  return reason;
}

std::string Connection::get(const std::string& id, v1::RegistrationJob& job) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::GetRegistrationJobRequest request;
  request.set_id(id);
  return reason_of(jobs_->GetRegistrationJob(&context, request, &job), context);
}

std::string Connection::cancel(const std::string& id, v1::RegistrationJob& job) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::CancelRegistrationJobRequest request;
  request.set_id(id);
  return reason_of(jobs_->CancelRegistrationJob(&context, request, &job), context);
}

std::string Connection::remove(const std::string& id) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::DeleteRegistrationJobRequest request;
  request.set_id(id);
  v1::DeleteRegistrationJobResponse response;
  return reason_of(jobs_->DeleteRegistrationJob(&context, request, &response), context);
}

std::string Connection::watch(const std::string& id, int events,
                              const std::function<void(const v1::RegistrationJob&)>& seen) {
  grpc::ClientContext context;
  set_deadline(context, glance);
  v1::WatchRegistrationJobRequest request;
  request.set_id(id);
  const auto reader = jobs_->WatchRegistrationJob(&context, request);
  v1::WatchRegistrationJobResponse event;
  while (events-- > 0 && reader->Read(&event)) seen(event.job());
  context.TryCancel();
  const grpc::Status status = reader->Finish();
  const bool is_left =
      status.error_code() == grpc::StatusCode::CANCELLED || status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
  return is_left ? "" : reason_of(status, context);
}

std::string Connection::watch_to_the_end(const std::string& id,
                                         const std::function<void(const v1::RegistrationJob&)>& seen) {
  grpc::ClientContext context;
  set_deadline(context, 5 * patience);
  v1::WatchRegistrationJobRequest request;
  request.set_id(id);
  const auto reader = jobs_->WatchRegistrationJob(&context, request);
  v1::WatchRegistrationJobResponse event;
  while (reader->Read(&event)) seen(event.job());
  return reason_of(reader->Finish(), context);
}

grpc::Status Connection::send(grpc::ClientContext& context, v1::WriteBlobRequest request, const std::string& bytes,
                              std::size_t end) {
  set_deadline(context, patience);
  v1::WriteBlobResponse response;
  const auto writer = blobs_->WriteBlob(&context, &response);
  request.set_digest(digest_of(bytes));
  request.set_size(static_cast<std::int64_t>(bytes.size()));
  const auto begin = static_cast<std::size_t>(request.write_offset());
  for (std::size_t at = begin; at == begin || at < end; at += piece) {
    request.set_data(bytes.substr(at, std::min(piece, end - at)));
    if (!writer->Write(request)) break;
    request.Clear();
  }
  if (end == bytes.size())
    writer->WritesDone();
  else
    context.TryCancel();
  return writer->Finish();
}

std::string Connection::upload(const std::string& bytes) {
  grpc::ClientContext context;
  const grpc::Status status = send(context, {}, bytes, bytes.size());
  if (const std::string reason = reason_of(status, context); !reason.empty())
    throw Violation("an upload was refused: " + reason);
  return digest_of(bytes);
}

bool Connection::upload_piece(const std::string& bytes, const std::string& upload_id, std::size_t begin,
                              std::size_t end) {
  grpc::ClientContext context;
  v1::WriteBlobRequest request;
  request.set_upload_id(upload_id);
  request.set_write_offset(static_cast<std::int64_t>(begin));
  const grpc::Status status = send(context, std::move(request), bytes, end);
  if (status.error_code() == grpc::StatusCode::CANCELLED && end < bytes.size()) return false;
  const std::string reason = reason_of(status, context);
  // The daemon may still be busy with the stream that was hung up before.
  if (reason == "OFFSET_MISMATCH" || reason == "UPLOAD_TAKEN_OVER") return false;
  if (!reason.empty()) throw Violation("an upload that goes on was refused: " + reason);
  return true;
}

v1::QueryWriteStatusResponse Connection::upload_status(const std::string& bytes, const std::string& upload_id) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::QueryWriteStatusRequest request;
  request.set_digest(digest_of(bytes));
  request.set_size(static_cast<std::int64_t>(bytes.size()));
  request.set_upload_id(upload_id);
  v1::QueryWriteStatusResponse response;
  if (const std::string reason = reason_of(blobs_->QueryWriteStatus(&context, request, &response), context);
      !reason.empty())
    throw Violation("the status of an upload was refused: " + reason);
  return response;
}

std::string Connection::download(const std::string& digest) {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::ReadBlobRequest request;
  request.set_digest(digest);
  const auto reader = blobs_->ReadBlob(&context, request);
  std::string bytes;
  for (v1::ReadBlobResponse response; reader->Read(&response);) bytes += response.data();
  if (const std::string reason = reason_of(reader->Finish(), context); !reason.empty())
    throw Violation("the blob " + digest + " cannot be read: " + reason);
  return bytes;
}

std::vector<std::string> Connection::missing(const std::vector<std::string>& digests) {
  constexpr std::size_t most = 1000;
  std::vector<std::string> found;
  for (std::size_t at = 0; at < digests.size(); at += most) {
    grpc::ClientContext context;
    set_deadline(context, patience);
    v1::FindMissingBlobsRequest request;
    for (std::size_t i = at; i < std::min(at + most, digests.size()); ++i) request.add_digests(digests[i]);
    v1::FindMissingBlobsResponse response;
    if (const std::string reason = reason_of(blobs_->FindMissingBlobs(&context, request, &response), context);
        !reason.empty())
      throw Violation("digests were refused: " + reason);
    found.insert(found.end(), response.missing().begin(), response.missing().end());
  }
  return found;
}

std::vector<v1::RegistrationJob> Connection::list_all() {
  std::vector<v1::RegistrationJob> jobs;
  v1::ListRegistrationJobsRequest request;
  request.set_page_size(1000);
  do {
    grpc::ClientContext context;
    set_deadline(context, patience);
    v1::ListRegistrationJobsResponse response;
    if (const std::string reason = reason_of(jobs_->ListRegistrationJobs(&context, request, &response), context);
        !reason.empty())
      throw Violation("a list was refused: " + reason);
    jobs.insert(jobs.end(), response.jobs().begin(), response.jobs().end());
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  return jobs;
}

v1::CollectGarbageResponse Connection::collect_garbage() {
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::CollectGarbageResponse response;
  if (const std::string reason = reason_of(admin_->CollectGarbage(&context, {}, &response), context); !reason.empty())
    throw Violation("collecting garbage was refused: " + reason);
  return response;
}

std::optional<v1::FsckResponse> Connection::check_blobs() {
  grpc::ClientContext context;
  set_deadline(context, patience);
  const auto reader = admin_->Fsck(&context, {});
  v1::FsckResponse response;
  while (reader->Read(&response)) {
  }
  const std::string reason = reason_of(reader->Finish(), context);
  if (reason == "RESOURCE_EXHAUSTED" || reason == "TOO_MANY_STREAMS") return std::nullopt;
  if (!reason.empty()) throw Violation("the check of the blobs was refused: " + reason);
  if (!response.is_done() || response.corrupt() + response.missing() + response.set_aside() > 0)
    throw Violation("the daemon finds its own blobs damaged: " + response.ShortDebugString());
  return response;
}

}  // namespace saltus::crash
