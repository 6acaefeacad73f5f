#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

/// The numbers that a client may run into. ServerInfo reports those that it can act upon.
namespace saltus::server::limits {

constexpr int kMessageBytes = 4 << 20;
constexpr std::size_t kUploadChunkBytes = 2 << 20;  // above it throughput falls and memory per stream grows
constexpr std::size_t kDownloadChunkBytes = 256 << 10;
constexpr std::int64_t kBlobBytes = std::int64_t{8} << 30;
constexpr std::int64_t kVoxels = std::int64_t{1} << 31;

constexpr int kQueuedJobs = 10000;
constexpr int kBatchJobs = 100;
constexpr int kDefaultPage = 50;
constexpr int kLargestPage = 1000;
constexpr int kDigestsPerCall = 1000;

constexpr int kWatchStreams = 256;
constexpr int kUploadStreams = 16;
constexpr int kDownloadStreams = 32;
// Of one identity, so that nobody takes all places.
constexpr int kWatchStreamsOfOne = 64;
constexpr int kUploadStreamsOfOne = 8;
constexpr int kDownloadStreamsOfOne = 8;
constexpr std::chrono::seconds kStalledStream{60};  // a transfer that has not moved for so long is cut off

constexpr std::size_t kRequestIdBytes = 36;
constexpr std::size_t kUploadIdBytes = 64;
constexpr std::size_t kStringBytes = 4096;
constexpr int kLabels = 32;
constexpr std::size_t kLabelNameBytes = 63;
constexpr std::size_t kLabelValueBytes = 256;
constexpr int kSettings = 256;
constexpr int kArtifacts = 64;
constexpr int kThreads = 256;
constexpr std::int64_t kMemoryBytes = std::int64_t{1} << 50;
constexpr std::int64_t kLimitSeconds = 366 * 24 * 3600;

constexpr int kMinPingIntervalMilliseconds = 10000;

}  // namespace saltus::server::limits

namespace saltus::server {

/// What one submitter who comes over TLS may have, as the daemon was told. 0: no limit.
struct SubmitterLimits {
  int queued_jobs = 0;
  std::int64_t upload_bytes = 0;  ///< of blobs on the server and on their way there
};

}  // namespace saltus::server
