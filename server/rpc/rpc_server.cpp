#include "server/rpc/rpc_server.h"

#include "server/rpc/call_interceptor.h"
#include "server/rpc/limits.h"

#include <grpc/grpc.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <stdexcept>

namespace saltus::server {
namespace {

// Enough that a few slow disk operations do not hold up the rest; each costs one stack.
constexpr int kPoolThreads = 4;
constexpr int kTransferThreads = 4;  // more of them take the cores from gRPC's threads, and are no faster

// Above what the gates of the streams let in: HTTP/2 does not refuse, it lets the client wait.
constexpr int kStreamsOfConnection = 512;
// So that clients come back to where a proxy or a new certificate wants them; streams have the grace to end.
constexpr int kConnectionAgeMilliseconds = 2 * 3600 * 1000;
constexpr int kConnectionGraceMilliseconds = 600 * 1000;

void prepare_grpc() {
  static const bool is_prepared = [] {
    // Held for good: the last to let go of gRPC waits for its threads, and one that has ever found a socket full looks
    // up only every 10 s. A daemon that has stopped would be there for as long.
    grpc_init();
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    return true;
  }();
  (void)is_prepared;
}

}  // namespace

RpcServer::RpcServer(const RpcSettings& settings, JobManager& jobs, BlobCatalog& blobs, Maintenance& maintenance,
                     StallWatch& stalls, const IdSource& ids)
    : authorisation_(settings.roles, settings.observer),
      pool_(kPoolThreads),
      transfers_(kTransferThreads),
      registration_(jobs, ids, authorisation_, pool_),
      blobs_(blobs, authorisation_, settings.limits.upload_bytes, pool_, transfers_, stalls),
      info_(jobs, settings.version, settings.limits),
      worker_(jobs, pool_),
      admin_(jobs, maintenance, transfers_, stalls, [this](bool is_draining) { health_.set_draining(is_draining); }) {
  prepare_grpc();
  grpc::ServerBuilder builder;
  builder.AddListeningPort(settings.address, grpc::InsecureServerCredentials(), &port_);
  protected_ports_.resize(settings.protected_addresses.size());
  if (!protected_ports_.empty()) {
    const auto credentials = tls_credentials(settings.tls, authorisation_);
    for (std::size_t i = 0; i < protected_ports_.size(); ++i)
      builder.AddListeningPort(settings.protected_addresses[i], credentials, &protected_ports_[i]);
  }
  builder.SetMaxReceiveMessageSize(limits::kMessageBytes);
  builder.SetMaxSendMessageSize(limits::kMessageBytes);
  // Two daemons on one port would share its connections.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS,
                             limits::kMinPingIntervalMilliseconds);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kStreamsOfConnection);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, kConnectionAgeMilliseconds);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_GRACE_MS, kConnectionGraceMilliseconds);
  if (settings.observer) {
    std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
    interceptors.push_back(make_call_interceptor(authorisation_, *settings.observer));
    builder.experimental().SetInterceptorCreators(std::move(interceptors));
  }
  builder.RegisterService(&registration_);
  builder.RegisterService(&blobs_);
  builder.RegisterService(&info_);
  builder.RegisterService(&worker_);
  builder.RegisterService(&admin_);
  server_ = builder.BuildAndStart();
  std::string addresses = settings.address;
  for (const std::string& address : settings.protected_addresses) addresses += ", " + address;
  // gRPC starts when one of several ports can be had; a daemon that is silently deaf on one would be no service.
  const bool is_deaf = std::find(protected_ports_.begin(), protected_ports_.end(), 0) != protected_ports_.end();
  if (!server_ || is_deaf)
    throw std::runtime_error("cannot listen on " + addresses + "; see that the address is free and may be used");
  health_.attach(*server_->GetHealthCheckService());
  self_ = v1::ServerInfoService::NewStub(server_->InProcessChannel({}));
}

void RpcServer::ping(std::function<void(std::chrono::steady_clock::duration)> told) {
  {
    std::lock_guard lock(mutex_);
    if (is_pinging_ || is_stopping_) return;
    is_pinging_ = true;
  }
  ping_ = std::make_unique<Ping>();
  const auto began = std::chrono::steady_clock::now();
  self_->async()->GetServerInfo(&ping_->context, &ping_->request, &ping_->answer,
                                [this, began, told = std::move(told)](const grpc::Status& status) {
                                  if (status.ok()) told(std::chrono::steady_clock::now() - began);
                                  std::lock_guard lock(mutex_);
                                  is_pinging_ = false;
                                  ping_ended_.notify_all();
                                });
}

RpcServer::~RpcServer() { stop(std::chrono::milliseconds(0)); }

void RpcServer::stop(std::chrono::milliseconds grace) {
  if (!server_) return;
  {
    // Before anything else: a call inside this process does not fail when its server goes, it jumps to nowhere.
    std::unique_lock lock(mutex_);
    is_stopping_ = true;
    ping_ended_.wait(lock, [this] { return !is_pinging_; });
  }
  health_.detach();
  server_->Shutdown(std::chrono::system_clock::now() + grace);
  server_->Wait();
  server_.reset();
}

}  // namespace saltus::server
