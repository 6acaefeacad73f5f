#include "client/lib/channel.h"

#include "client/lib/client_error.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/security/credentials.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <random>

namespace saltus::client {
namespace {

using Clock = std::chrono::steady_clock;

std::chrono::milliseconds shortened_at_random(std::chrono::milliseconds delay) {
  thread_local std::minstd_rand generator{std::random_device{}()};
  return std::chrono::milliseconds(
      std::uniform_int_distribution<std::int64_t>(delay.count() / 2, delay.count())(generator));
}

}  // namespace

std::shared_ptr<grpc::Channel> make_channel(const std::string& address, const TlsIdentity& tls) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 30000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10000);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  // In spite of its name, how long one attempt to connect may take: a busy machine or a long way needs some seconds. A
  // daemon that is not there refuses at once, so nothing waits for this.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 10000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
  // Channels with equal arguments share one connection unless told otherwise.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  const auto credentials = tls.is_set() ? grpc::SslCredentials({tls.authority, tls.key, tls.certificate})
                                        : grpc::InsecureChannelCredentials();
  return grpc::CreateCustomChannel(address, credentials, arguments);
}

bool wait_for(const std::stop_token& stop, std::chrono::milliseconds time) {
  std::mutex mutex;
  std::condition_variable_any changed;
  std::unique_lock lock(mutex);
  changed.wait_for(lock, stop, time, [] { return false; });
  return !stop.stop_requested();
}

void call(const CallSettings& settings, CallKind kind,
          const std::function<grpc::Status(grpc::ClientContext&, bool&)>& attempt) {
  auto delay = settings.retry.first_delay;
  std::optional<Clock::time_point> give_up_at;
  while (true) {
    grpc::ClientContext context;
    if (kind == CallKind::Unary) context.set_deadline(std::chrono::system_clock::now() + settings.unary_deadline);
    bool moved = false;
    grpc::Status status;
    {
      std::stop_callback cancel_on_stop(settings.stop, [&context] { context.TryCancel(); });
      status = attempt(context, moved);
    }
    if (status.ok()) return;
    const ClientError error = error_of(status, context, settings.address);
    const bool is_at_a_limit = status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && error.retry_after();
    if (status.error_code() != grpc::StatusCode::UNAVAILABLE && !is_at_a_limit) throw error;
    if (moved || !give_up_at) {
      give_up_at = Clock::now() + settings.retry.patience;
      delay = settings.retry.first_delay;
    }
    const auto least = error.retry_after().value_or(std::chrono::milliseconds(0));
    if (Clock::now() + std::max(delay, least) > *give_up_at) throw error;
    if (!wait_for(settings.stop, std::max(shortened_at_random(delay), least)))
      throw ClientError(grpc::StatusCode::CANCELLED, "STOPPED", "stopped while waiting for " + settings.address);
    delay = std::min(2 * delay, settings.retry.longest_delay);
  }
}

}  // namespace saltus::client
