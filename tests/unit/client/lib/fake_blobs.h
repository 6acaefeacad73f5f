#pragma once

#include "client/lib/blob_transfer.h"
#include "proto/crc32c.h"
#include "tests/support/fake_daemon.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace saltus::client {

/// Keeps blobs in memory; can cut a transfer or spoil a byte, once.
class FakeBlobs : public v1::BlobService::Service {
 public:
  std::map<std::string, std::string> blobs;
  std::vector<std::int64_t> read_offsets;
  int cut_reads_after = -1;   ///< messages of the first read; -1: never
  int cut_writes_after = -1;  ///< the same for writes
  bool spoil_data = false;
  bool spoil_writes = false;
  int writes = 0;
  int refusals = 0;         ///< questions that are answered RESOURCE_EXHAUSTED first
  std::string retry_after;  ///< in milliseconds, what these say about waiting; "" nothing
  std::size_t longest_message = 0;
  std::map<std::string, std::string> parts;  ///< what is safe of uploads, by upload_id
  std::filesystem::path uploads;             ///< where it looks for files that it is given; empty: nowhere
  bool spoil_given = false;                  ///< the first of them
  std::vector<std::int64_t> write_offsets;
  std::vector<std::string> upload_ids;
  int take_overs = 0;  ///< uploads that are answered UPLOAD_TAKEN_OVER first
  int late_parts = 0;  ///< uploads of which another byte becomes safe after the question

  grpc::Status FindMissingBlobs(grpc::ServerContext* context, const v1::FindMissingBlobsRequest* request,
                                v1::FindMissingBlobsResponse* response) override {
    if (refusals > 0) {
      --refusals;
      context->AddTrailingMetadata("saltus-reason", "TOO_MANY");
      if (!retry_after.empty()) context->AddTrailingMetadata("saltus-retry-after-ms", retry_after);
      return {grpc::StatusCode::RESOURCE_EXHAUSTED, "too many"};
    }
    for (const std::string& digest : request->digests())
      if (!blobs.count(digest)) response->add_missing(digest);
    return grpc::Status::OK;
  }

  grpc::Status WriteBlob(grpc::ServerContext* context, grpc::ServerReader<v1::WriteBlobRequest>* reader,
                         v1::WriteBlobResponse* response) override {
    ++writes;
    v1::WriteBlobRequest request;
    std::string digest, id;
    std::int64_t size = -1;
    for (int message = 0; reader->Read(&request); ++message) {
      if (message == 0) {
        digest = request.digest();
        size = request.size();
        id = request.upload_id();
        write_offsets.push_back(request.write_offset());
        upload_ids.push_back(id);
        if (request.write_offset() != static_cast<std::int64_t>(parts[id].size())) {
          context->AddTrailingMetadata("saltus-reason", "OFFSET_MISMATCH");
          return {grpc::StatusCode::ABORTED, "another offset"};
        }
        if (take_overs > 0) {
          --take_overs;
          context->AddTrailingMetadata("saltus-reason", "UPLOAD_TAKEN_OVER");
          return {grpc::StatusCode::ABORTED, "taken over"};
        }
      } else if (!request.digest().empty() || request.size() != 0 || request.write_offset() != 0) {
        return {grpc::StatusCode::INVALID_ARGUMENT, "digest, size and offset belong to the first message"};
      }
      if (message == cut_writes_after) {
        cut_writes_after = -1;
        return {grpc::StatusCode::UNAVAILABLE, "cut"};
      }
      longest_message = std::max(longest_message, request.data().size());
      parts[id] += request.data();
      if (spoil_writes) parts[id].back() ^= 1;
    }
    const std::string data = std::move(parts[id]);
    parts.erase(id);
    if (testing_support::digest_of(data) != digest || static_cast<std::int64_t>(data.size()) != size) {
      context->AddTrailingMetadata("saltus-reason", "DIGEST_MISMATCH");
      return {grpc::StatusCode::INVALID_ARGUMENT, "digest or size differ"};
    }
    blobs[digest] = data;
    response->set_digest(digest);
    return grpc::Status::OK;
  }

  grpc::Status QueryWriteStatus(grpc::ServerContext*, const v1::QueryWriteStatusRequest* request,
                                v1::QueryWriteStatusResponse* response) override {
    const bool is_complete = blobs.count(request->digest()) > 0;
    const auto given = uploads / (request->upload_id() + "." + std::to_string(request->size()) + "." +
                                  request->digest().substr(std::string("sha256:").size()) + ".part");
    if (!uploads.empty() && std::filesystem::exists(given)) {
      parts[request->upload_id()] = testing_support::content_of(given);
      if (spoil_given) parts[request->upload_id()].back() ^= 1;
      spoil_given = false;
    }
    response->set_complete(is_complete);
    std::string& part = parts[request->upload_id()];
    response->set_committed_size(is_complete ? request->size() : static_cast<std::int64_t>(part.size()));
    if (late_parts > 0) {
      --late_parts;
      part += late_byte;
    }
    return grpc::Status::OK;
  }
  char late_byte = '?';

  grpc::Status ReadBlob(grpc::ServerContext*, const v1::ReadBlobRequest* request,
                        grpc::ServerWriter<v1::ReadBlobResponse>* writer) override {
    read_offsets.push_back(request->offset());
    const auto found = blobs.find(request->digest());
    if (found == blobs.end()) return {grpc::StatusCode::NOT_FOUND, "no blob " + request->digest()};
    const std::string& data = found->second;
    constexpr std::size_t chunk = 1000;
    int message = 0;
    for (auto at = static_cast<std::size_t>(request->offset()); at < data.size(); at += chunk, ++message) {
      if (message == cut_reads_after) {
        cut_reads_after = -1;
        return {grpc::StatusCode::UNAVAILABLE, "cut"};
      }
      v1::ReadBlobResponse response;
      response.set_offset(static_cast<std::int64_t>(at));
      response.set_size(static_cast<std::int64_t>(data.size()));
      response.set_data(data.substr(at, chunk));
      response.set_crc32c(crc32c(response.data()));
      if (spoil_data) (*response.mutable_data())[0] ^= 1;
      writer->Write(response);
    }
    return grpc::Status::OK;
  }
};

inline std::string many_bytes(std::size_t count) {
  std::string data(count, '\0');
  std::uint32_t state = 12345;
  for (char& byte : data) byte = static_cast<char>((state = state * 1664525u + 1013904223u) >> 24);
  return data;
}

class BlobTransferTest : public testing::Test {
 protected:
  FakeBlobs service;
  testing_support::FakeDaemon daemon{&service};
  testing_support::TemporaryFolder folder;
  BlobTransfer transfer{make_channel(daemon.settings().address), daemon.settings()};
};

}  // namespace saltus::client
