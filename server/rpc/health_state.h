#pragma once

#include <grpcpp/health_check_service_interface.h>

#include <mutex>
#include <string>
#include <vector>

namespace saltus::server {

/// What health says of each service. The server answers calls before its own object is there: what is said until then
/// is told to it as soon as it comes. Thread-safe.
class HealthState {
 public:
  /// From now on `health` is told, until detach(). It must outlive that.
  void attach(grpc::HealthCheckServiceInterface& health);
  void detach();

  /// No new jobs are taken.
  void set_draining(bool is_draining);
  /// What writes no longer works; final.
  void set_read_only();
  /// Nothing is served any more; final.
  void set_not_serving();

 private:
  void tell();

  std::mutex mutex_;
  grpc::HealthCheckServiceInterface* health_ = nullptr;
  bool is_draining_ = false, is_read_only_ = false, is_stopping_ = false;
};

}  // namespace saltus::server
