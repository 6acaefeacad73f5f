#pragma once

#include <chrono>
#include <string>
#include <vector>

namespace saltus::server {

/// What is told of a call that has ended.
struct CallRecord {
  std::string method;  ///< as on the wire
  std::string identity;
  bool is_local = true;
  bool is_change = false;
  std::string code;               ///< gRPC's, "OK", "NOT_FOUND"...
  std::vector<std::string> jobs;  ///< ids that the request or the answer names
  std::string blob;               ///< digest that the request names
  std::chrono::steady_clock::duration time{};
};

/// Is told of every call. Called from gRPC's threads: must not block or throw.
class CallObserver {
 public:
  virtual ~CallObserver() = default;
  virtual void began(const std::string& method) = 0;
  virtual void received_blob_bytes(std::size_t count) = 0;
  virtual void sent_blob_bytes(std::size_t count) = 0;
  /// Once for each began().
  virtual void ended(const CallRecord& call) = 0;
  /// A call that was turned away at the gate, and so never began.
  virtual void denied(const CallRecord& call) = 0;
};

}  // namespace saltus::server
