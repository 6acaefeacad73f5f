#pragma once

#include "server/daemon.h"
#include "server/store/sha256.h"
#include "tests/support/server_fakes.h"
#include "tests/support/temporary_folder.h"

#include "saltus/v1/registration.grpc.pb.h"
#include "saltus/v1/worker.grpc.pb.h"

#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace saltus::testing_support {

inline std::string trailer_of(const grpc::ClientContext& context, const char* key) {
  const auto& trailers = context.GetServerTrailingMetadata();
  const auto found = trailers.find(key);
  return found == trailers.end() ? "" : std::string(found->second.data(), found->second.size());
}
inline std::string reason_of(const grpc::ClientContext& context) { return trailer_of(context, "saltus-reason"); }

/// A daemon in this process on a unix socket, with a launcher that starts nothing: the test speaks as the worker.
class DaemonTest : public ::testing::Test {
 protected:
  /// Lost jobs are tried again at once: the delay is tested on a clock that the test moves.
  DaemonTest() { job_settings.queue.retry_delay = std::chrono::milliseconds(0); }
  /// Here and not in the destructor: what the test's own class has given the daemon to call is gone by then.
  void TearDown() override { crash(); }

  void start(server::DaemonParts parts = {}) {
    server::DaemonSettings settings;
    settings.data = folder / "data";
    settings.listen = {server::ListenAddress::Kind::UnixSocket, folder / "socket", "", 0};
    settings.jobs = job_settings;
    settings.reserve = reserve;
    settings.version = "1.2.3";
    if (tune) tune(settings);
    if (!parts.launcher) parts.launcher = make_launcher();
    daemon = std::make_unique<server::Daemon>(
        settings, [this](const std::string& reason) { on_broken(reason); }, std::move(parts));
    connect(daemon->address());
  }
  void connect(const std::string& address) {
    // A connection of its own for each daemon: one that has seen the last one go waits before it tries again.
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    channel = grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
    jobs = v1::RegistrationService::NewStub(channel);
    blobs = v1::BlobService::NewStub(channel);
    info = v1::ServerInfoService::NewStub(channel);
    worker = v1::WorkerService::NewStub(channel);
  }
  /// The daemon goes without a word to its workers, whose processes `adoptable` lets the next one find.
  void crash() { daemon.reset(); }

  std::unique_ptr<FakeLauncher> make_launcher() {
    auto made = std::make_unique<FakeLauncher>();
    made->adoptable = adoptable;
    launcher = made.get();
    return made;
  }

  static std::string digest_of(const std::string& content) {
    server::Sha256 hash;
    hash.add(content);
    return "sha256:" + hash.hex();
  }

  grpc::Status upload(const std::string& content, const std::string& digest, std::size_t chunk = 1 << 20) {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest request;
    request.set_digest(digest);
    request.set_size(static_cast<std::int64_t>(content.size()));
    bool is_open = writer->Write(request);
    request.Clear();
    for (std::size_t at = 0; is_open && at < content.size(); at += chunk) {
      request.set_data(content.substr(at, chunk));
      is_open = writer->Write(request);
    }
    writer->WritesDone();
    return writer->Finish();
  }
  /// The first message of an upload that can be continued.
  static v1::WriteBlobRequest announcement(const std::string& content, std::size_t offset = 0,
                                           const std::string& id = "id") {
    v1::WriteBlobRequest request;
    request.set_digest(digest_of(content));
    request.set_size(static_cast<std::int64_t>(content.size()));
    request.set_upload_id(id);
    request.set_write_offset(static_cast<std::int64_t>(offset));
    return request;
  }
  /// One stream of an upload that can be continued: the bytes from `offset` on, at most `count` of them.
  grpc::Status upload_part(const std::string& content, std::size_t offset, std::size_t count,
                           std::string* reason = nullptr, const std::string& id = "id", std::size_t chunk = 1 << 20) {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest request = announcement(content, offset, id);
    const std::size_t end = std::min(content.size(), offset + count);
    bool is_open = writer->Write(request);
    request.Clear();
    for (std::size_t at = offset; is_open && at < end; at += chunk) {
      request.set_data(content.substr(at, std::min(chunk, end - at)));
      is_open = writer->Write(request);
    }
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    if (reason) *reason = reason_of(context);
    return status;
  }
  v1::QueryWriteStatusResponse write_status(const std::string& content, const std::string& id = "id") {
    grpc::ClientContext context;
    v1::QueryWriteStatusRequest request;
    request.set_digest(digest_of(content));
    request.set_size(static_cast<std::int64_t>(content.size()));
    request.set_upload_id(id);
    v1::QueryWriteStatusResponse response;
    const auto status = blobs->QueryWriteStatus(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response;
  }
  std::string uploaded(const std::string& content) {
    const auto status = upload(content, digest_of(content));
    EXPECT_TRUE(status.ok()) << status.error_message();
    return digest_of(content);
  }

  v1::CreateRegistrationJobRequest valid_request() {
    v1::CreateRegistrationJobRequest request;
    request.mutable_spec()->mutable_fixed()->set_digest(uploaded("fixed"));
    request.mutable_spec()->mutable_fixed()->set_format("mha");
    request.mutable_spec()->mutable_moving()->set_digest(uploaded("moving"));
    request.mutable_spec()->mutable_moving()->set_format("nii.gz");
    return request;
  }
  grpc::Status create(const v1::CreateRegistrationJobRequest& request, v1::RegistrationJob& job) {
    grpc::ClientContext context;
    return jobs->CreateRegistrationJob(&context, request, &job);
  }
  v1::RegistrationJob created() {
    v1::RegistrationJob job;
    const auto status = create(valid_request(), job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }
  v1::RegistrationJob get(const std::string& id) {
    grpc::ClientContext context;
    v1::GetRegistrationJobRequest request;
    request.set_id(id);
    v1::RegistrationJob job;
    const auto status = jobs->GetRegistrationJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }
  v1::RegistrationJob cancel(const std::string& id) {
    grpc::ClientContext context;
    v1::CancelRegistrationJobRequest request;
    request.set_id(id);
    v1::RegistrationJob job;
    const auto status = jobs->CancelRegistrationJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }
  grpc::Status remove(const std::string& id) {
    grpc::ClientContext context;
    v1::DeleteRegistrationJobRequest request;
    request.set_id(id);
    v1::DeleteRegistrationJobResponse response;
    return jobs->DeleteRegistrationJob(&context, request, &response);
  }

  template <class Request>
  static Request as_worker(const server::LaunchRequest& launch) {
    Request request;
    request.set_job_id(launch.key.job_id);
    request.set_attempt(launch.key.attempt);
    request.set_token(launch.token);
    return request;
  }
  grpc::Status acquire(const server::LaunchRequest& launch, v1::AcquireLeaseResponse& response) {
    grpc::ClientContext context;
    return worker->AcquireLease(&context, as_worker<v1::AcquireLeaseRequest>(launch), &response);
  }
  grpc::Status heartbeat(const server::LaunchRequest& launch, int iteration, v1::HeartbeatResponse& response) {
    grpc::ClientContext context;
    auto request = as_worker<v1::HeartbeatRequest>(launch);
    request.mutable_progress()->set_stage(v1::JOB_STAGE_OPTIMISING);
    request.mutable_progress()->set_iteration(iteration);
    return worker->Heartbeat(&context, request, &response);
  }
  grpc::Status complete(const v1::CompleteJobRequest& request) {
    grpc::ClientContext context;
    v1::CompleteJobResponse response;
    return worker->CompleteJob(&context, request, &response);
  }
  /// Uploads `content` as the one artefact and completes.
  grpc::Status succeed(const server::LaunchRequest& launch, const std::string& content = "field") {
    auto request = as_worker<v1::CompleteJobRequest>(launch);
    auto* artifact = request.mutable_success()->add_artifacts();
    artifact->set_name("displacement.nii.gz");
    artifact->set_digest(uploaded(content));
    artifact->set_size(static_cast<std::int64_t>(content.size()));
    return complete(request);
  }

  TemporaryFolder folder;
  std::function<void(server::DaemonSettings&)> tune;  ///< changes what the next start uses
  server::ManagerSettings job_settings;
  server::ReserveSettings reserve{0, 0};
  std::function<void(const std::string&)> on_broken = [](const std::string& reason) { ADD_FAILURE() << reason; };
  std::set<server::AttemptKey> adoptable;
  FakeLauncher* launcher = nullptr;
  std::unique_ptr<server::Daemon> daemon;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::RegistrationService::Stub> jobs;
  std::unique_ptr<v1::BlobService::Stub> blobs;
  std::unique_ptr<v1::ServerInfoService::Stub> info;
  std::unique_ptr<v1::WorkerService::Stub> worker;
};

}  // namespace saltus::testing_support
