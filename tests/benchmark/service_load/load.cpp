#include "tests/benchmark/service_load/load.h"

#include "saltus/v1/admin.grpc.pb.h"
#include "saltus/v1/registration.grpc.pb.h"
#include "tests/benchmark/service_load/client_calls.h"
#include "tests/benchmark/service_load/measured_daemon.h"
#include "tests/benchmark/service_load/pinger.h"
#include "tests/support/child_process.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

namespace saltus::benchmark {
namespace {

using Clock = std::chrono::steady_clock;
using testing_support::ChildProcess;

constexpr std::chrono::milliseconds kBetweenSamples{100};
constexpr std::chrono::seconds kBetweenCollections{2};  // what has been uploaded must not fill the disk
constexpr int kWatchersOfConnection = 25;

constexpr double kPingTarget = 50, kMemoryTarget = 300, kGrowthTarget = 10, kFilesTarget = 10, kRestartTarget = 5;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

class Load {
 public:
  explicit Load(const LoadOptions& options) : options_(options) {}

  std::vector<Figure> run() {
    daemon_.start();
    daemon_.prepare("fixed", "moving");
    fill_queue();
    measure_idle();
    measure_busy();
    add_rows();
    restart();
    daemon_.stop();
    return figures_;
  }

 private:
  void tell(const std::string& what) const { std::fprintf(stderr, "%s\n", what.c_str()); }

  void add(std::string name, double value, std::string unit, int digits = 1, double target = Figure::kNoTarget) {
    figures_.push_back(
        {std::move(name), value, std::move(unit), options_.is_judged ? target : Figure::kNoTarget, digits});
  }

  double memory() const { return resident_mebibytes(daemon_.id()); }

  void fill_queue() {
    tell("queueing " + std::to_string(options_.queued) + " jobs");
    // The first one is what the worker holds.
    queued_.push_back(daemon_.create());
    const auto begin = Clock::now();
    queued_.resize(static_cast<std::size_t>(options_.queued) + 1);
    in_parallel(options_.queued, [&](int i) { queued_[static_cast<std::size_t>(i) + 1] = daemon_.create(); });
    add("jobs accepted, " + std::to_string(kSubmitters) + " at a time", options_.queued / seconds_since(begin), "/s",
        0);
  }

  ChildProcess start_pinger(int seconds) const {
    return ChildProcess({options_.self, "--ping", daemon_.address(), "--seconds", std::to_string(seconds)});
  }
  static Pings result_of(ChildProcess& pinger) {
    if (pinger.wait() != 0) throw std::runtime_error("the pinger failed: " + pinger.err());
    return parse_pings(pinger.out());
  }

  void measure_idle() {
    ChildProcess pinger = start_pinger(std::min(5, options_.seconds));
    const Pings pings = result_of(pinger);
    add("ping without load, p50", quantile(pings.times, 0.5), "ms");
    add("ping without load, p99", quantile(pings.times, 0.99), "ms");
  }

  void measure_busy() {
    tell("measuring for " + std::to_string(options_.seconds) + " s");
    add("load average of the machine before", load_average(), "");
    std::atomic<long> events{0}, uploaded{0}, failed{0};
    std::vector<std::shared_ptr<grpc::ClientContext>> contexts;
    std::vector<std::shared_ptr<grpc::Channel>> channels;
    std::vector<std::jthread> clients;
    const auto end = [&] {
      for (auto& client : clients) client.request_stop();
      for (auto& context : contexts) context->TryCancel();
      clients.clear();
    };
    // Whatever is thrown, the threads end before what they use.
    const std::unique_ptr<void, std::function<void(void*)>> at_the_end(this, [&](void*) { end(); });
    for (int i = 0; i < options_.watchers; ++i) {
      if (i % kWatchersOfConnection == 0) channels.push_back(connect(daemon_.address()));
      contexts.push_back(std::make_shared<grpc::ClientContext>());
      // Every other one watches the job that runs.
      const std::size_t watched = i % 2 == 0 ? 0 : static_cast<std::size_t>(i) % queued_.size();
      clients.emplace_back([&, id = queued_[watched], channel = channels.back(), context = contexts.back()] {
        const auto stub = v1::RegistrationService::NewStub(channel);
        v1::WatchRegistrationJobRequest request;
        request.set_id(id);
        const auto reader = stub->WatchRegistrationJob(context.get(), request);
        v1::WatchRegistrationJobResponse event;
        while (reader->Read(&event)) ++events;
        if (reader->Finish().error_code() != grpc::StatusCode::CANCELLED) ++failed;
      });
    }
    for (int i = 0; i < options_.uploads; ++i)
      clients.emplace_back([&, i](const std::stop_token& stop) {
        const auto stub = v1::BlobService::NewStub(connect(daemon_.address()));
        std::string data(static_cast<std::size_t>(options_.upload_mebibytes) << 20, 'x');
        for (long n = 0; !stop.stop_requested(); ++n) {
          const std::string mark = std::to_string(i) + " " + std::to_string(n) + " ";
          std::copy(mark.begin(), mark.end(), data.begin());
          (upload(*stub, data).ok() ? uploaded : failed) += 1;
        }
      });
    clients.emplace_back([&](const std::stop_token& stop) {
      const auto admin = v1::AdminService::NewStub(connect(daemon_.address()));
      std::mutex mutex;
      std::condition_variable_any stopped;
      std::unique_lock lock(mutex);
      while (!stop.stop_requested()) {
        grpc::ClientContext context;
        v1::CollectGarbageResponse response;
        if (!admin->CollectGarbage(&context, {}, &response).ok()) ++failed;
        stopped.wait_for(lock, stop, kBetweenCollections, [] { return false; });
      }
    });
    const double used_before = processor_seconds(daemon_.id()), busy_before = busy_seconds_of_machine();
    const double own_before = processor_seconds(::getpid());
    Series memory_at, files_at;
    const auto begin = Clock::now();
    ChildProcess pinger = start_pinger(options_.seconds);
    // What it prints at its end is read afterwards, and may be more than fits into a pipe: it is not waited for here.
    const testing_support::ProcessHandle pinging(pinger.id());
    while (seconds_since(begin) < options_.seconds && !pinging.ends_within(kBetweenSamples)) {
      memory_at.add(seconds_since(begin), memory());
      files_at.add(seconds_since(begin), open_files(daemon_.id()));
    }
    const double seconds = seconds_since(begin);
    const double used = processor_seconds(daemon_.id()) - used_before;
    const double own = processor_seconds(::getpid()) - own_before;
    const double others = busy_seconds_of_machine() - busy_before - used - own;
    const auto done = uploaded.load();
    const Pings pings = result_of(pinger);
    end();
    if (failed > 0) throw std::runtime_error(std::to_string(failed) + " watchers, uploads or collections have failed");

    add("ping, p50", quantile(pings.times, 0.5), "ms");
    add("ping, p99", quantile(pings.times, 0.99), "ms", 1, kPingTarget);
    add("ping, longest", quantile(pings.times, 1), "ms");
    add("sent later than due (a thread that only sleeps), p99", quantile(pings.lateness, 0.99), "ms");
    add("uploaded by " + std::to_string(options_.uploads) + " streams",
        static_cast<double>(done) * options_.upload_mebibytes / seconds, "MiB/s", 0);
    add("events to " + std::to_string(options_.watchers) + " watchers", static_cast<double>(events) / seconds, "/s", 0);
    add("memory of the daemon, most", memory_at.most(), "MiB", 0, kMemoryTarget);
    add("memory, last quarter less second quarter", memory_at.mean_between(0.75, 1) - memory_at.mean_between(0.25, 0.5),
        "MiB", 1, kGrowthTarget);
    add("memory, slope of the second half", memory_at.slope_of_second_half(), "MiB/min");
    add("open files of the daemon, most", files_at.most(), "", 0);
    add("open files, last quarter less second quarter",
        files_at.mean_between(0.75, 1) - files_at.mean_between(0.25, 0.5), "", 1, kFilesTarget);
    add("cores used by the daemon", used / seconds, "");
    add("cores used by the clients", own / seconds, "");
    add("cores used by everything else", others / seconds, "");
  }

  /// Cancelled jobs: rows that stay.
  void add_rows() {
    const int more = options_.rows - options_.queued;
    if (more <= 0) return;
    tell("adding " + std::to_string(more) + " rows");
    // Room in the queue for those that are made and cancelled at once.
    for (int i = 0; i < std::min(2 * kSubmitters, options_.queued); ++i)
      daemon_.cancel(queued_[queued_.size() - 1 - static_cast<std::size_t>(i)]);
    in_parallel(more, [&](int) { daemon_.cancel(daemon_.create()); });
  }

  void restart() {
    daemon_.kill();
    const auto begin = Clock::now();
    daemon_.start();
    grpc::ClientContext context;
    v1::ServerInfo answer;
    require(v1::ServerInfoService::NewStub(daemon_.channel())->GetServerInfo(&context, {}, &answer),
            "ping after the restart");
    add("restart with " + std::to_string(std::max(options_.rows, options_.queued)) + " rows after kill -9",
        seconds_since(begin), "s", 2, kRestartTarget);
    add("memory after the restart", memory(), "MiB", 0);
  }

  const LoadOptions options_;
  MeasuredDaemon daemon_{options_.daemon, {"--worker", options_.self, "--slots", "1", "--keep-inputs-days", "0"}};
  std::vector<std::string> queued_;
  std::vector<Figure> figures_;
};

}  // namespace

std::vector<Figure> run_load(const LoadOptions& options) { return Load(options).run(); }

}  // namespace saltus::benchmark
