#include "tests/benchmark/service_load/pinger.h"

#include "saltus/v1/registration.grpc.pb.h"

#include <grpcpp/create_channel.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace saltus::benchmark {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kBetweenPings{10};

double milliseconds_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

struct Call {
  grpc::ClientContext context;
  v1::GetServerInfoRequest request;
  v1::ServerInfo answer;
  grpc::Status status;
  double time = 0;
};

}  // namespace

Pings ping(const std::string& address, double seconds) {
  const auto info = v1::ServerInfoService::NewStub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  std::deque<Call> calls;
  std::mutex mutex;
  std::condition_variable answered;
  int open = 0;
  Pings pings;
  const auto send = [&] {
    Call& call = calls.emplace_back();
    {
      std::lock_guard lock(mutex);
      ++open;
    }
    info->async()->GetServerInfo(&call.context, &call.request, &call.answer,
                                 [&, sent = Clock::now()](const grpc::Status& status) {
                                   call.time = milliseconds_since(sent);
                                   call.status = status;
                                   std::lock_guard lock(mutex);
                                   --open;
                                   answered.notify_all();
                                 });
  };
  const auto wait = [&] {
    std::unique_lock lock(mutex);
    answered.wait(lock, [&] { return open == 0; });
  };
  // The first one waits for the connection, which is not what is measured.
  send();
  wait();
  const auto begin = Clock::now();
  for (auto due = begin; milliseconds_since(begin) < 1000 * seconds; due += kBetweenPings) {
    std::this_thread::sleep_until(due);
    pings.lateness.push_back(milliseconds_since(due));
    send();
  }
  wait();
  for (const Call& call : calls) {
    if (!call.status.ok()) throw std::runtime_error("ping: " + call.status.error_message());
    pings.times.push_back(call.time);
  }
  pings.times.erase(pings.times.begin());
  return pings;
}

std::string to_text(const Pings& pings) {
  std::ostringstream text;
  for (std::size_t i = 0; i < pings.times.size(); ++i) text << pings.times[i] << ' ' << pings.lateness[i] << '\n';
  return text.str();
}

Pings parse_pings(const std::string& text) {
  Pings pings;
  std::istringstream in(text);
  for (double time = 0, lateness = 0; in >> time >> lateness;) {
    pings.times.push_back(time);
    pings.lateness.push_back(lateness);
  }
  if (pings.times.empty()) throw std::runtime_error("no ping was measured");
  return pings;
}

}  // namespace saltus::benchmark
