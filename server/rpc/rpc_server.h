#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/jobs/id_source.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/blob_service.h"
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
  /// Listens at once on an address as gRPC writes it. Throws std::runtime_error when it cannot.
  RpcServer(const std::string& address, JobManager& jobs, BlobCatalog& blobs, const IdSource& ids,
            const std::string& version);
  /// Ends all calls.
  ~RpcServer();

  /// The port that was chosen; means nothing for a unix socket.
  int port() const { return port_; }
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
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace saltus::server
