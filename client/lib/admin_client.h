#pragma once

#include "client/lib/channel.h"

#include "saltus/v1/admin.grpc.pb.h"

#include <functional>
#include <memory>

namespace saltus::client {

/// What an administrator asks of a daemon. Thread-safe; each method blocks and throws ClientError.
class AdminClient {
 public:
  explicit AdminClient(CallSettings settings);

  /// Takes no new jobs and starts none, or takes them again.
  v1::DrainResponse drain(bool resume);
  v1::CollectGarbageResponse collect_garbage();
  /// Calls `told` with what the daemon tells on the way, and returns the last of it. A check that is cut is not begun
  /// again.
  v1::FsckResponse fsck(const std::function<void(const v1::FsckResponse&)>& told);

 private:
  CallSettings settings_;
  std::unique_ptr<v1::AdminService::Stub> stub_;
};

}  // namespace saltus::client
