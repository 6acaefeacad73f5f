#pragma once

#include "client/lib/blob_transfer.h"
#include "client/lib/client_error.h"

#include "saltus/v1/registration.pb.h"

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace saltus::client {

/// True for SUCCEEDED, FAILED and CANCELLED, which never change.
bool is_terminal(v1::JobState state);

/// Everything a user of the service needs: upload, create, follow, fetch.
///
/// Thread-safe. Each method blocks, repeats calls that find the daemon unavailable as settings.retry says, and throws
/// ClientError (the codes are listed with each rpc in proto/saltus/v1/registration.proto) or LocalFileError.
class RegistrationClient {
 public:
  /// Connects on first use. `settings.address`: "unix:/path" or "host:port".
  explicit RegistrationClient(CallSettings settings);

  /// Sends a file, unless the daemon has it, and returns what a RegistrationSpec wants to know of it.
  v1::InputFile upload_file(const std::filesystem::path& file, const std::string& format);

  /// Makes the request id itself, so that a repeated call cannot make a second job.
  v1::RegistrationJob create(const v1::RegistrationSpec& spec, const std::map<std::string, std::string>& labels = {});
  /// The same with everything that can be asked for; a request id that `request` has is kept.
  v1::RegistrationJob create(v1::CreateRegistrationJobRequest request);
  /// All of them or none; at most ServerInfo.max_batch_jobs.
  std::vector<v1::RegistrationJob> create_all(std::vector<v1::CreateRegistrationJobRequest> requests);
  v1::RegistrationJob get(const std::string& id);
  /// Newest first; follows the pages until there are `limit` jobs or no more. JOB_STATE_UNSPECIFIED: all states.
  std::vector<v1::RegistrationJob> list(v1::JobState state, int limit);
  /// The same with the conditions of `request`; its pages are seen to here.
  std::vector<v1::RegistrationJob> list(v1::ListRegistrationJobsRequest request, int limit);
  v1::RegistrationJob cancel(const std::string& id);
  void remove(const std::string& id);
  v1::ServerInfo server_info();

  /// Calls `seen` with the present state at once and then with every change; returns the job in its terminal state.
  /// Uses a connection of its own. When the stream breaks, or ends before the job does, it is opened again, so a
  /// restart of the daemon does not end a watch; gives up `watch_patience` after the last sign of life.
  v1::RegistrationJob watch(const std::string& id, const std::function<void(const v1::RegistrationJob&)>& seen,
                            std::chrono::milliseconds watch_patience = std::chrono::seconds(60));

  /// Writes one artefact of a succeeded job, complete or not at all.
  void download(const v1::Artifact& artifact, const std::filesystem::path& file);

 private:
  CallSettings settings_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::RegistrationService::Stub> stub_;
  std::unique_ptr<v1::ServerInfoService::Stub> info_stub_;
  BlobTransfer blobs_;
};

}  // namespace saltus::client
