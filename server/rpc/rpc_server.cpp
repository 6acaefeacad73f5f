#include "server/rpc/rpc_server.h"

#include "server/rpc/limits.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/server_builder.h>

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <stdexcept>

namespace saltus::server {
namespace {

// Enough that a few slow disk operations do not hold up the rest; each costs one stack.
constexpr int kPoolThreads = 8;

/// gRPC replaces a socket file without asking whether somebody still listens on it.
void require_nobody_listens(const std::string& path) {
  const int descriptor = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) throw std::runtime_error(std::string("cannot make a socket: ") + std::strerror(errno));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  const int result = ::connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  ::close(descriptor);
  if (result == 0)
    throw std::runtime_error("--listen is unix:" + path + ", where another program listens; stop it or choose another path");
}

void enable_extensions() {
  static const bool is_enabled = [] {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    return true;
  }();
  (void)is_enabled;
}

}  // namespace

RpcServer::RpcServer(const ListenAddress& address, JobManager& jobs, BlobCatalog& blobs, const IdSource& ids,
                     const std::string& version)
    : pool_(kPoolThreads),
      registration_(jobs, ids, pool_),
      blobs_(blobs, pool_),
      info_(jobs, version),
      worker_(jobs, pool_) {
  enable_extensions();
  const bool is_socket = address.kind == ListenAddress::Kind::UnixSocket;
  if (is_socket) require_nobody_listens(address.path);

  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(address.to_text(), grpc::InsecureServerCredentials(), &port);
  builder.SetMaxReceiveMessageSize(limits::kMessageBytes);
  builder.SetMaxSendMessageSize(limits::kMessageBytes);
  // Two daemons on one port would share its connections.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, limits::kMinPingIntervalMilliseconds);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.RegisterService(&registration_);
  builder.RegisterService(&blobs_);
  builder.RegisterService(&info_);
  builder.RegisterService(&worker_);
  server_ = builder.BuildAndStart();
  if (!server_)
    throw std::runtime_error("cannot listen on " + address.to_text() + "; see that the address is free and may be used");
  if (is_socket && ::chmod(address.path.c_str(), 0660) != 0)
    throw std::runtime_error("cannot set the permissions of " + address.path + ": " + std::strerror(errno));

  ListenAddress bound = address;
  if (!is_socket) bound.port = port;
  address_ = bound.to_text();
}

RpcServer::~RpcServer() { stop(std::chrono::milliseconds(0)); }

void RpcServer::set_not_serving() { server_->GetHealthCheckService()->SetServingStatus(false); }

void RpcServer::stop(std::chrono::milliseconds grace) {
  if (!server_) return;
  server_->Shutdown(std::chrono::system_clock::now() + grace);
  server_->Wait();
  server_.reset();
}

}  // namespace saltus::server
