#include "tests/benchmark/service_load/many_workers.h"

#include "saltus/v1/worker.grpc.pb.h"
#include "tests/benchmark/service_load/client_calls.h"
#include "tests/benchmark/service_load/measured_daemon.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <stdexcept>

namespace saltus::benchmark {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kIdleRounds = 200;
constexpr std::chrono::milliseconds kAfterALimit{100};

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

/// Of calls of one kind, in milliseconds.
using Times = std::vector<double>;

template <class Call>
grpc::Status timed(Times& times, Call call) {
  grpc::ClientContext context;
  const auto begin = Clock::now();
  const grpc::Status status = call(context);
  times.push_back(1000 * seconds_since(begin));
  return status;
}

struct WorkerTimes {
  Times take, acquire, complete, whole;
};

/// One worker that comes by itself, with a solver that takes no time.
class FakeWorker {
 public:
  FakeWorker(const std::string& address, int number, int artifact_bytes)
      : channel_(connect(address)),
        worker_(v1::WorkerService::NewStub(channel_)),
        blobs_(v1::BlobService::NewStub(channel_)),
        number_(number),
        artifact_(static_cast<std::size_t>(artifact_bytes), 'x') {}

  /// Nothing when there was no job in the time.
  std::optional<v1::TakeJobResponse> take(double wait_seconds) {
    v1::TakeJobRequest request;
    request.set_threads(1);
    request.set_wait_seconds(wait_seconds);
    v1::TakeJobResponse job;
    Times waited;
    require(timed(waited, [&](auto& context) { return worker_->TakeJob(&context, request, &job); }), "take");
    if (job.job_id().empty()) return std::nullopt;
    times.take.push_back(waited.front());
    return job;
  }
  v1::AcquireLeaseResponse acquire(const v1::TakeJobResponse& job) {
    auto request = identified<v1::AcquireLeaseRequest>(job);
    v1::AcquireLeaseResponse terms;
    require(timed(times.acquire, [&](auto& context) { return worker_->AcquireLease(&context, request, &terms); }),
            "acquire");
    return terms;
  }
  double heartbeat(const v1::TakeJobResponse& job, int iteration) {
    auto request = identified<v1::HeartbeatRequest>(job);
    request.mutable_progress()->set_stage(v1::JOB_STAGE_OPTIMISING);
    request.mutable_progress()->set_iteration(iteration);
    v1::HeartbeatResponse answer;
    Times time;
    require(timed(time, [&](auto& context) { return worker_->Heartbeat(&context, request, &answer); }), "heartbeat");
    return time.front();
  }
  void finish(const v1::TakeJobResponse& job, const v1::AcquireLeaseResponse& terms) {
    for (const auto& digest : {terms.spec().fixed().digest(), terms.spec().moving().digest()}) fetch(digest);
    heartbeat(job, 1);
    // Another one each time, as results are.
    const std::string mark = std::to_string(number_) + " " + std::to_string(++made_) + " ";
    std::copy(mark.begin(), mark.end(), artifact_.begin());
    again_at_a_limit([&] { return upload(*blobs_, artifact_); }, "upload");
    auto request = identified<v1::CompleteJobRequest>(job);
    auto* made = request.mutable_success()->add_artifacts();
    made->set_name("displacement.mha");
    made->set_digest(digest_of(artifact_));
    made->set_size(static_cast<std::int64_t>(artifact_.size()));
    require(timed(times.complete,
                  [&](auto& context) {
                    v1::CompleteJobResponse answer;
                    return worker_->CompleteJob(&context, request, &answer);
                  }),
            "complete");
    auto end = identified<v1::ReportExitRequest>(job);
    grpc::ClientContext context;
    v1::ReportExitResponse answer;
    require(worker_->ReportExit(&context, end, &answer), "report");
  }

  WorkerTimes times;
  int turned_away = 0;  ///< transfers that found too many streams

 private:
  template <class Request>
  static Request identified(const v1::TakeJobResponse& job) {
    Request request;
    request.set_job_id(job.job_id());
    request.set_attempt(job.attempt());
    request.set_token(job.token());
    return request;
  }
  /// Streams are limited, and whoever is turned away comes back, as the client library does.
  template <class Call>
  void again_at_a_limit(Call call, const char* what) {
    while (true) {
      const grpc::Status status = call();
      if (status.error_code() != grpc::StatusCode::RESOURCE_EXHAUSTED) return require(status, what);
      ++turned_away;
      std::this_thread::sleep_for(kAfterALimit);
    }
  }
  void fetch(const std::string& digest) {
    again_at_a_limit(
        [&] {
          grpc::ClientContext context;
          v1::ReadBlobRequest request;
          request.set_digest(digest);
          const auto reader = blobs_->ReadBlob(&context, request);
          v1::ReadBlobResponse part;
          while (reader->Read(&part)) continue;
          return reader->Finish();
        },
        "fetch");
  }

  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::WorkerService::Stub> worker_;
  std::unique_ptr<v1::BlobService::Stub> blobs_;
  const int number_;
  int made_ = 0;
  std::string artifact_;
};

class ManyWorkers {
 public:
  explicit ManyWorkers(const WorkersOptions& options) : options_(options) {}

  std::vector<Figure> run() {
    start();
    measure_throughput();
    measure_idle();
    measure_heartbeats();
    daemon_.stop();
    return figures_;
  }

 private:
  void start() {
    daemon_.start();
    daemon_.prepare(std::string(65536, 'f'), std::string(65536, 'm'));
    for (int i = 0; i < options_.workers; ++i)
      workers_.push_back(std::make_unique<FakeWorker>(daemon_.address(), i, options_.artifact_kibibytes << 10));
  }

  void add(std::string name, double value, std::string unit, int digits = 1) {
    figures_.push_back({std::move(name), value, std::move(unit), Figure::kNoTarget, digits});
  }
  void add_times(const std::string& name, const Times& times) {
    add(name + ", p50", quantile(times, 0.5), "ms");
    add(name + ", p99", quantile(times, 0.99), "ms");
  }

  /// Runs `work` of every worker on a thread of its own; throws what the first that failed has thrown.
  template <class Work>
  void with_all_workers(Work work) {
    std::exception_ptr error;
    std::atomic_flag has_failed;
    {
      std::vector<std::jthread> threads;
      for (auto& worker : workers_)
        threads.emplace_back([&, &one = *worker] {
          try {
            work(one);
          } catch (...) {
            if (!has_failed.test_and_set()) error = std::current_exception();
          }
        });
    }
    if (error) std::rethrow_exception(error);
  }

  void measure_throughput() {
    in_parallel(options_.jobs, [&](int) { daemon_.create(); });
    add("load average of the machine before", load_average(), "");
    std::atomic<int> left{options_.jobs};
    const auto begin = Clock::now();
    const double used = processor_seconds(daemon_.id());
    with_all_workers([&](FakeWorker& worker) {
      while (left > 0) {
        const auto job_begin = Clock::now();
        const auto job = worker.take(0.5);
        if (!job) continue;
        worker.finish(*job, worker.acquire(*job));
        worker.times.whole.push_back(1000 * seconds_since(job_begin));
        --left;
      }
    });
    const double seconds = seconds_since(begin);
    Times take, acquire, complete, whole;
    for (const auto& worker : workers_) {
      const auto append = [](Times& to, const Times& from) { to.insert(to.end(), from.begin(), from.end()); };
      append(take, worker->times.take);
      append(acquire, worker->times.acquire);
      append(complete, worker->times.complete);
      append(whole, worker->times.whole);
    }
    if (take.size() != static_cast<std::size_t>(options_.jobs)) throw std::runtime_error("a job was given twice");
    add("jobs by " + std::to_string(options_.workers) + " workers that take no time", options_.jobs / seconds, "/s");
    add_times("taking a job from a full queue", take);
    add_times("acquiring its lease", acquire);
    add_times("completing it", complete);
    add_times("a whole job", whole);
    int turned_away = 0;
    for (const auto& worker : workers_) turned_away += worker->turned_away;
    add("transfers that found too many streams and came again", turned_away, "", 0);
    const double used_now = processor_seconds(daemon_.id());
    add("processor time of the daemon for a job", 1000 * (used_now - used) / options_.jobs, "ms", 2);
    add("cores used by the daemon", (used_now - used) / seconds, "");
    add("memory of the daemon", resident_mebibytes(daemon_.id()), "MiB", 0);
    add("open files of the daemon", open_files(daemon_.id()), "", 0);
  }

  /// All wait, a job comes: how long until a worker has its lease.
  void measure_idle() {
    std::mutex mutex;
    std::condition_variable changed;
    int leased = 0;
    std::atomic<bool> is_over{false};
    std::exception_ptr error;
    std::vector<std::jthread> threads;
    for (auto& worker : workers_)
      threads.emplace_back([&, &one = *worker] {
        try {
          while (!is_over) {
            const auto job = one.take(0.5);
            if (!job) continue;
            const auto terms = one.acquire(*job);
            {
              std::lock_guard lock(mutex);
              ++leased;
              changed.notify_all();
            }
            one.finish(*job, terms);
          }
        } catch (...) {
          std::lock_guard lock(mutex);
          error = std::current_exception();
          changed.notify_all();
        }
      });
    Times times;
    for (int round = 1; round <= kIdleRounds && !error; ++round) {
      const auto begin = Clock::now();
      daemon_.create();
      std::unique_lock lock(mutex);
      changed.wait(lock, [&] { return leased >= round || error; });
      times.push_back(1000 * seconds_since(begin));
    }
    is_over = true;
    threads.clear();
    if (error) std::rethrow_exception(error);
    add_times("from submission to the lease of a worker that waits", times);
  }

  /// As many heartbeats as so many workers send, two a second each.
  void measure_heartbeats() {
    in_parallel(options_.workers, [&](int) { daemon_.create(); });
    const auto begin = Clock::now();
    std::mutex mutex;
    Times all;
    const double used = processor_seconds(daemon_.id());
    const auto between =
        std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * options_.workers / options_.heartbeats_per_second));
    with_all_workers([&](FakeWorker& worker) {
      const auto job = worker.take(10);
      if (!job) throw std::runtime_error("no job for a worker");
      const auto terms = worker.acquire(*job);
      Times times;
      auto due = Clock::now();
      for (int iteration = 1; seconds_since(begin) < options_.seconds; ++iteration) {
        std::this_thread::sleep_until(due);
        times.push_back(worker.heartbeat(*job, iteration));
        due += between;
      }
      worker.finish(*job, terms);
      std::lock_guard lock(mutex);
      all.insert(all.end(), times.begin(), times.end());
    });
    const double seconds = seconds_since(begin);
    add("heartbeats", static_cast<double>(all.size()) / seconds, "/s", 0);
    add_times("a heartbeat", all);
    add("cores used by the daemon meanwhile", (processor_seconds(daemon_.id()) - used) / seconds, "", 2);
  }

  const WorkersOptions options_;
  MeasuredDaemon daemon_{options_.daemon, {"--slots", "0", "--threads-per-job", "1"}};
  std::vector<std::unique_ptr<FakeWorker>> workers_;
  std::vector<Figure> figures_;
};

}  // namespace

std::vector<Figure> run_many_workers(const WorkersOptions& options) { return ManyWorkers(options).run(); }

}  // namespace saltus::benchmark
