#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/jobs/id_source.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/blob_service.h"
#include "server/rpc/listen_address.h"
#include "server/rpc/registration_service.h"
#include "server/rpc/server_info_service.h"
#include "server/rpc/task_pool.h"
#include "server/rpc/worker_service.h"

#include <grpcpp/server.h>

#include <chrono>
#include <memory>
#include <string>

namespace saltus::server {

/// All services, health and reflection on one listener.
class RpcServer {
 public:
  /// Listens at once. Throws std::runtime_error when it cannot.
  RpcServer(const ListenAddress& address, JobManager& jobs, BlobCatalog& blobs, const IdSource& ids,
            const std::string& version);
  /// Ends all calls.
  ~RpcServer();

  /// What clients use as an address; with the port that was chosen.
  const std::string& address() const { return address_; }
  /// Health becomes NOT_SERVING; calls still work.
  void set_not_serving();
  /// Takes no new calls, gives those under way until `grace` is over, then cancels them.
  void stop(std::chrono::milliseconds grace);

 private:
  TaskPool pool_;
  RegistrationServiceImpl registration_;
  BlobServiceImpl blobs_;
  ServerInfoServiceImpl info_;
  WorkerServiceImpl worker_;
  std::string address_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace saltus::server
