#include "server/worker/result_sender.h"

#include "client/lib/client_error.h"

#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>

namespace saltus::worker {

std::vector<v1::Artifact> send_results(const std::vector<std::string>& names, const SendOne& send,
                                       const std::stop_token& stop) {
  std::vector<v1::Artifact> artifacts(names.size());
  std::atomic<std::size_t> next = 0;
  std::stop_source both;
  const std::stop_callback passed_on(stop, [&both] { both.request_stop(); });
  std::mutex mutex;
  std::exception_ptr first_failure;
  const auto work = [&] {
    try {
      for (std::size_t i = next++; i < names.size(); i = next++) {
        if (both.stop_requested())
          throw client::ClientError(grpc::StatusCode::CANCELLED, "STOPPED", "stopped before all results were sent");
        const client::FileDigest sent = send(i, both.get_token());
        artifacts[i].set_name(names[i]);
        artifacts[i].set_digest(sent.digest);
        artifacts[i].set_size(sent.size);
      }
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!first_failure) first_failure = std::current_exception();
      both.request_stop();
    }
  };
  std::jthread beside;
  if (names.size() > 1) try {
      beside = std::jthread(work);
    } catch (const std::system_error&) {  // it takes longer alone
    }
  work();
  if (beside.joinable()) beside.join();
  if (first_failure) std::rethrow_exception(first_failure);
  return artifacts;
}

}  // namespace saltus::worker
