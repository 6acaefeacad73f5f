#pragma once

#include "client/lib/checksum.h"
#include "proto/crc32c.h"

#include "saltus/v1/registration.grpc.pb.h"
#include "saltus/v1/worker.grpc.pb.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace saltus::testing_support {

/// Blobs in memory.
class FakeBlobs : public v1::BlobService::Service {
 public:
  std::string put(const std::string& bytes) {
    client::Sha256 sha;
    sha.add(bytes);
    const std::string digest = sha.digest();
    std::lock_guard lock(mutex_);
    blobs_[digest] = bytes;
    return digest;
  }
  std::string get(const std::string& digest) {
    std::lock_guard lock(mutex_);
    return blobs_.at(digest);
  }

  grpc::Status FindMissingBlobs(grpc::ServerContext*, const v1::FindMissingBlobsRequest* request,
                                v1::FindMissingBlobsResponse* response) override {
    std::lock_guard lock(mutex_);
    for (const std::string& digest : request->digests())
      if (!blobs_.contains(digest)) response->add_missing(digest);
    return grpc::Status::OK;
  }
  /// The next `count` uploads find the disk full, and are told when there may be room.
  void fill_disk(int count, std::chrono::milliseconds retry_after) {
    std::lock_guard lock(mutex_);
    refusals_ = count;
    retry_after_ = retry_after;
  }
  /// From now on no file may be as large as anything that comes.
  void limit_files() {
    std::lock_guard lock(mutex_);
    is_limited_ = true;
  }
  int refusals_left() {
    std::lock_guard lock(mutex_);
    return refusals_;
  }
  grpc::Status WriteBlob(grpc::ServerContext* context, grpc::ServerReader<v1::WriteBlobRequest>* reader,
                         v1::WriteBlobResponse*) override {
    {
      std::lock_guard lock(mutex_);
      if (is_limited_) {
        context->AddTrailingMetadata("saltus-reason", "FILE_TOO_LARGE");
        return {grpc::StatusCode::FAILED_PRECONDITION, "no file may be so large"};
      }
      if (refusals_ > 0) {
        --refusals_;
        context->AddTrailingMetadata("saltus-reason", "STORAGE_FULL");
        context->AddTrailingMetadata("saltus-retry-after-ms", std::to_string(retry_after_.count()));
        return {grpc::StatusCode::RESOURCE_EXHAUSTED, "the disk is full"};
      }
    }
    std::string bytes;
    for (v1::WriteBlobRequest request; reader->Read(&request);) bytes += request.data();
    put(bytes);
    return grpc::Status::OK;
  }
  grpc::Status QueryWriteStatus(grpc::ServerContext*, const v1::QueryWriteStatusRequest*,
                                v1::QueryWriteStatusResponse*) override {
    return grpc::Status::OK;  // an upload that was cut begins again
  }
  grpc::Status ReadBlob(grpc::ServerContext*, const v1::ReadBlobRequest* request,
                        grpc::ServerWriter<v1::ReadBlobResponse>* writer) override {
    std::string bytes;
    {
      std::lock_guard lock(mutex_);
      const auto found = blobs_.find(request->digest());
      if (found == blobs_.end()) return {grpc::StatusCode::NOT_FOUND, "no such blob"};
      bytes = found->second;
    }
    constexpr std::size_t chunk = 1 << 18;
    for (std::size_t at = static_cast<std::size_t>(request->offset()); at < bytes.size(); at += chunk) {
      v1::ReadBlobResponse response;
      response.set_offset(static_cast<std::int64_t>(at));
      response.set_size(static_cast<std::int64_t>(bytes.size()));
      response.set_data(bytes.substr(at, chunk));
      response.set_crc32c(crc32c(response.data()));
      if (!writer->Write(response)) break;
    }
    return grpc::Status::OK;
  }

 private:
  std::mutex mutex_;
  int refusals_ = 0;
  bool is_limited_ = false;
  std::chrono::milliseconds retry_after_{};
  std::map<std::string, std::string> blobs_;
};

/// The daemon's side of one attempt: grants `terms` and keeps what the worker says.
class FakeWorkerService : public v1::WorkerService::Service {
 public:
  v1::AcquireLeaseResponse terms;  ///< to be filled in before the worker starts

  /// Waits until `is_reached` says so of what has been heard. Throws when it does not come for very long.
  void wait_until(const std::function<bool()>& is_reached) {
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, std::chrono::seconds(120), is_reached))
      throw std::runtime_error("the worker did not get on");
  }
  v1::HeartbeatRequest last_heartbeat;
  std::vector<v1::Checkpoint> checkpoints;
  std::optional<v1::CompleteJobRequest> outcome;
  std::atomic<bool> is_lost = false;  ///< from now on the attempt is another's
  grpc::Status completion;            ///< what CompleteJob answers; to be set before the worker starts

  grpc::Status AcquireLease(grpc::ServerContext*, const v1::AcquireLeaseRequest*,
                            v1::AcquireLeaseResponse* response) override {
    *response = terms;
    return grpc::Status::OK;
  }
  grpc::Status Heartbeat(grpc::ServerContext*, const v1::HeartbeatRequest* request,
                         v1::HeartbeatResponse* response) override {
    hear([&] { last_heartbeat = *request; });
    if (is_lost) return {grpc::StatusCode::ABORTED, "the attempt is no longer wanted"};
    response->set_command(v1::HeartbeatResponse::COMMAND_CONTINUE);
    return grpc::Status::OK;
  }
  grpc::Status PutCheckpoint(grpc::ServerContext*, const v1::PutCheckpointRequest* request,
                             v1::PutCheckpointResponse*) override {
    hear([&] { checkpoints.push_back(request->checkpoint()); });
    return grpc::Status::OK;
  }
  grpc::Status CompleteJob(grpc::ServerContext*, const v1::CompleteJobRequest* request,
                           v1::CompleteJobResponse*) override {
    hear([&] { outcome = *request; });
    return completion;
  }

 private:
  void hear(const std::function<void()>& what) {
    std::lock_guard lock(mutex_);
    what();
    changed_.notify_all();
  }
  std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace saltus::testing_support
