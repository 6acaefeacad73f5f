#include "server/rpc/health_state.h"

#include "saltus/v1/admin.grpc.pb.h"
#include "saltus/v1/registration.grpc.pb.h"
#include "saltus/v1/worker.grpc.pb.h"

namespace saltus::server {

void HealthState::attach(grpc::HealthCheckServiceInterface& health) {
  const std::lock_guard lock(mutex_);
  health_ = &health;
  tell();
}

void HealthState::detach() {
  const std::lock_guard lock(mutex_);
  health_ = nullptr;
}

void HealthState::set_draining(bool is_draining) {
  const std::lock_guard lock(mutex_);
  is_draining_ = is_draining;
  tell();
}

void HealthState::set_read_only() {
  const std::lock_guard lock(mutex_);
  is_read_only_ = true;
  tell();
}

void HealthState::set_not_serving() {
  const std::lock_guard lock(mutex_);
  is_stopping_ = true;
  tell();
}

void HealthState::tell() {
  if (!health_) return;
  const bool serves = !is_stopping_, writes = serves && !is_read_only_;
  health_->SetServingStatus(v1::RegistrationService::service_full_name(), writes && !is_draining_);
  health_->SetServingStatus(v1::BlobService::service_full_name(), writes);
  health_->SetServingStatus(v1::WorkerService::service_full_name(), writes);
  health_->SetServingStatus(v1::ServerInfoService::service_full_name(), serves);
  health_->SetServingStatus(v1::AdminService::service_full_name(), serves);
  health_->SetServingStatus("", writes);
}

}  // namespace saltus::server
