#include "client/lib/registration_client.h"

#include <algorithm>
#include <array>
#include <random>

namespace saltus::client {
namespace {

/// 32 hex digits from the system's random source; enough to never meet again.
std::string make_request_id() {
  std::random_device source;
  std::string id;
  for (int word = 0; word < 4; ++word) {
    std::uint32_t bits = source();
    for (int digit = 0; digit < 8; ++digit, bits >>= 4) id += "0123456789abcdef"[bits & 15];
  }
  return id;
}

template <class Stub, class Request, class Response>
Response unary(const CallSettings& settings, Stub& stub,
               grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*), const Request& request) {
  Response response;
  call(settings, CallKind::Unary,
       [&](grpc::ClientContext& context, bool&) { return (stub.*method)(&context, request, &response); });
  return response;
}

}  // namespace

bool is_terminal(v1::JobState state) {
  return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED;
}

RegistrationClient::RegistrationClient(CallSettings settings)
    : settings_(std::move(settings)),
      channel_(make_channel(settings_.address, settings_.tls)),
      stub_(v1::RegistrationService::NewStub(channel_)),
      info_stub_(v1::ServerInfoService::NewStub(channel_)),
      blobs_(channel_, settings_) {}

v1::InputFile RegistrationClient::upload_file(const std::filesystem::path& file, const std::string& format) {
  v1::InputFile input;
  input.set_digest(blobs_.upload(file).digest);
  input.set_format(format);
  return input;
}

v1::RegistrationJob RegistrationClient::create(const v1::RegistrationSpec& spec,
                                               const std::map<std::string, std::string>& labels) {
  v1::CreateRegistrationJobRequest request;
  *request.mutable_spec() = spec;
  request.mutable_labels()->insert(labels.begin(), labels.end());
  return create(std::move(request));
}

v1::RegistrationJob RegistrationClient::create(v1::CreateRegistrationJobRequest request) {
  if (request.request_id().empty()) request.set_request_id(make_request_id());
  return unary(settings_, *stub_, &v1::RegistrationService::Stub::CreateRegistrationJob, request);
}

std::vector<v1::RegistrationJob> RegistrationClient::create_all(
    std::vector<v1::CreateRegistrationJobRequest> requests) {
  v1::BatchCreateRegistrationJobsRequest batch;
  for (v1::CreateRegistrationJobRequest& request : requests) {
    if (request.request_id().empty()) request.set_request_id(make_request_id());
    *batch.add_requests() = std::move(request);
  }
  const auto made = unary(settings_, *stub_, &v1::RegistrationService::Stub::BatchCreateRegistrationJobs, batch);
  return {made.jobs().begin(), made.jobs().end()};
}

v1::RegistrationJob RegistrationClient::get(const std::string& id) {
  v1::GetRegistrationJobRequest request;
  request.set_id(id);
  return unary(settings_, *stub_, &v1::RegistrationService::Stub::GetRegistrationJob, request);
}

std::vector<v1::RegistrationJob> RegistrationClient::list(v1::JobState state, int limit) {
  v1::ListRegistrationJobsRequest request;
  request.set_state(state);
  return list(std::move(request), limit);
}

std::vector<v1::RegistrationJob> RegistrationClient::list(v1::ListRegistrationJobsRequest request, int limit) {
  std::vector<v1::RegistrationJob> jobs;
  while (static_cast<int>(jobs.size()) < limit) {
    request.set_page_size(std::min(limit - static_cast<int>(jobs.size()), 1000));
    auto page = unary(settings_, *stub_, &v1::RegistrationService::Stub::ListRegistrationJobs, request);
    std::move(page.mutable_jobs()->begin(), page.mutable_jobs()->end(), std::back_inserter(jobs));
    if (page.next_page_token().empty()) break;
    request.set_page_token(page.next_page_token());
  }
  return jobs;
}

v1::RegistrationJob RegistrationClient::cancel(const std::string& id) {
  v1::CancelRegistrationJobRequest request;
  request.set_id(id);
  return unary(settings_, *stub_, &v1::RegistrationService::Stub::CancelRegistrationJob, request);
}

void RegistrationClient::remove(const std::string& id) {
  v1::DeleteRegistrationJobRequest request;
  request.set_id(id);
  unary(settings_, *stub_, &v1::RegistrationService::Stub::DeleteRegistrationJob, request);
}

v1::ServerInfo RegistrationClient::server_info() {
  return unary(settings_, *info_stub_, &v1::ServerInfoService::Stub::GetServerInfo, v1::GetServerInfoRequest());
}

v1::RegistrationJob RegistrationClient::watch(const std::string& id,
                                              const std::function<void(const v1::RegistrationJob&)>& seen,
                                              std::chrono::milliseconds watch_patience) {
  // A watcher sits on its stream for hours; on the common connection it would take a slot from the others.
  const auto stub = v1::RegistrationService::NewStub(make_channel(settings_.address, settings_.tls));
  CallSettings settings = settings_;
  settings.retry.patience = watch_patience;
  v1::WatchRegistrationJobRequest request;
  request.set_id(id);
  v1::RegistrationJob last;
  call(settings, CallKind::Stream, [&](grpc::ClientContext& context, bool& moved) {
    auto reader = stub->WatchRegistrationJob(&context, request);
    v1::WatchRegistrationJobResponse response;
    while (reader->Read(&response)) {
      moved = true;
      last = response.job();
      seen(last);
    }
    const grpc::Status status = reader->Finish();
    if (is_terminal(last.state())) return grpc::Status::OK;
    if (status.ok()) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "the stream ended before the job");
    return status;
  });
  return last;
}

void RegistrationClient::download(const v1::Artifact& artifact, const std::filesystem::path& file) {
  blobs_.download(artifact.digest(), file);
}

}  // namespace saltus::client
