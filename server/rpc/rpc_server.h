#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/jobs/id_source.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/maintenance.h"
#include "server/rpc/admin_service.h"
#include "server/rpc/authorisation.h"
#include "server/rpc/blob_service.h"
#include "server/rpc/health_state.h"
#include "server/rpc/listener.h"
#include "server/rpc/registration_service.h"
#include "server/rpc/server_info_service.h"
#include "server/rpc/stall_watch.h"
#include "server/rpc/task_pool.h"
#include "server/rpc/worker_service.h"

#include <grpcpp/server.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace saltus::server {

struct RpcSettings {
  std::string address;  ///< as gRPC writes it; for callers on this machine, who may do everything
  std::vector<std::string> protected_addresses;  ///< with mutual TLS
  TlsFiles tls;                                  ///< for these
  std::shared_ptr<const RolesFile> roles;        ///< of those who come over them; null: nobody has a right
  std::string version;
  SubmitterLimits limits;
  CallObserver* observer = nullptr;  ///< must outlive the server
};

/// All services, health and reflection on all listeners.
class RpcServer {
 public:
  /// Listens at once. Throws std::runtime_error when it cannot, InvalidInput when a TLS file cannot be used.
  RpcServer(const RpcSettings& settings, JobManager& jobs, BlobCatalog& blobs, Maintenance& maintenance,
            StallWatch& stalls, const IdSource& ids);
  /// Ends all calls.
  ~RpcServer();

  /// The port that was chosen; means nothing for a unix socket.
  int port() const { return port_; }
  /// In the order of the addresses.
  const std::vector<int>& protected_ports() const { return protected_ports_; }
  /// Makes one call to this server, past the network, unless the last one is still under way: `told` gets the time from
  /// end to end, on another thread. One thread at a time. Makes none once stop() has begun.
  void ping(std::function<void(std::chrono::steady_clock::duration)> told);
  /// Health becomes NOT_SERVING; calls still work.
  void set_not_serving() { health_.set_not_serving(); }
  /// The services that write become NOT_SERVING, and so does the whole; what only reads still works.
  void set_read_only() { health_.set_read_only(); }
  /// Takes no new calls, gives those under way until `grace` is over, then cancels them.
  void stop(std::chrono::milliseconds grace);

 private:
  const Authorisation authorisation_;
  TaskPool pool_;
  TaskPool transfers_;  // of whole images and checks of the store: no short call waits behind them
  RegistrationServiceImpl registration_;
  BlobServiceImpl blobs_;
  ServerInfoServiceImpl info_;
  WorkerServiceImpl worker_;
  HealthState health_;
  AdminServiceImpl admin_;
  int port_ = 0;
  std::vector<int> protected_ports_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<v1::ServerInfoService::Stub> self_;
  // A call to ourselves. It must not end on a thread of gRPC: the last one to hold a channel shuts these threads down.
  struct Ping {
    grpc::ClientContext context;
    v1::GetServerInfoRequest request;
    v1::ServerInfo answer;
  };
  std::unique_ptr<Ping> ping_;
  std::mutex mutex_;
  std::condition_variable ping_ended_;
  bool is_pinging_ = false;
  bool is_stopping_ = false;
};

}  // namespace saltus::server
