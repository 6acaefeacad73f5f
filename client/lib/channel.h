#pragma once

#include <grpcpp/channel.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

namespace saltus::client {

/// How long calls that find the daemon unavailable, or at a limit that time lifts, are repeated before they fail.
/// Delays double from `first_delay` to `longest_delay`, each shortened at random by up to a half so that many clients
/// do not come back at once.
struct RetryPolicy {
  std::chrono::milliseconds first_delay{100};
  std::chrono::milliseconds longest_delay{2000};
  std::chrono::milliseconds patience{5000};  ///< from the first failure; 0: no retries
};

/// Mutual TLS, as the contents of PEM files: whom to believe, and who we are. Empty for an address on this machine.
struct TlsIdentity {
  std::string authority;    ///< of the daemon's certificate
  std::string certificate;  ///< ours
  std::string key;          ///< of our certificate

  bool is_set() const { return !certificate.empty(); }
};

/// The daemon's blobs as files, where this program sees them. What is not there, or does not have the bytes that its
/// name says, comes over the connection, and what cannot be put there goes over it.
struct SharedBlobs {
  std::filesystem::path folder;     ///< the daemon's blobs/sha256, to read; empty: not seen from here
  std::filesystem::path uploads{};  ///< the daemon's uploads, to put files in; empty: not from here
  std::string given_as{};           ///< what ids of files that are put there begin with, see BlobTransfer::give
  /// The daemon ends with this program and nobody else asks it for anything, so that a blob's file may go on under the
  /// name that it is wanted under.
  bool are_ours = false;
};

/// What every call of one client has in common.
struct CallSettings {
  std::string address;  ///< named in errors
  TlsIdentity tls{};
  RetryPolicy retry;
  std::chrono::milliseconds unary_deadline{30000};
  std::stop_token stop;  ///< when requested, running calls end with CANCELLED and waits end early
  SharedBlobs blobs{};
};

/// A channel with a connection of its own, so that a slow stream on one never delays another.
/// `address`: "unix:/path" or "host:port". Keepalive 30 s, 10 s to answer; proxies of the environment are ignored.
std::shared_ptr<grpc::Channel> make_channel(const std::string& address, const TlsIdentity& tls = {});

/// What a call may last: a unary call has CallSettings::unary_deadline, a stream lasts as long as it moves.
enum class CallKind { Unary, Stream };

/// Runs `attempt` until it answers neither UNAVAILABLE nor RESOURCE_EXHAUSTED with a time to wait, or patience is over,
/// or stop is requested. A time to wait that the daemon gave is kept, unless it goes beyond the patience.
/// `attempt` may set `moved` when the stream got further than before: patience then begins anew.
/// Throws ClientError when the last answer is not OK.
void call(const CallSettings& settings, CallKind kind,
          const std::function<grpc::Status(grpc::ClientContext& context, bool& moved)>& attempt);

/// Waits. False when stop was requested before the time was over.
bool wait_for(const std::stop_token& stop, std::chrono::milliseconds time);

}  // namespace saltus::client
