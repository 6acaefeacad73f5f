#include "server/observe/metrics.h"

#include <prometheus/collectable.h>
#include <prometheus/counter.h>
#include <prometheus/exposer.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <fstream>
#include <mutex>
#include <stdexcept>
#include <system_error>

#include <unistd.h>

namespace saltus::server {
namespace {

using Seconds = std::chrono::duration<double>;
using Buckets = prometheus::Histogram::BucketBoundaries;

const Buckets kCallSeconds = {0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1, 5, 30, 300};
const Buckets kCommitSeconds = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 5};
const Buckets kGroupSizes = {1, 2, 4, 8, 16, 32, 64, 128};
const Buckets kJobSeconds = {1, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400, 43200};

double seconds_between(WallTime begin, WallTime end) { return Seconds(end - begin).count(); }

}  // namespace

/// Measured when somebody asks.
class AtScrape final : public prometheus::Collectable {
 public:
  explicit AtScrape(std::filesystem::path data) : data_(std::move(data)) {}

  std::vector<prometheus::MetricFamily> Collect() const override {
    std::vector<prometheus::MetricFamily> families;
    std::error_code error;
    const auto space = std::filesystem::space(data_, error);
    if (!error)
      families.push_back(gauge("saltusd_disk_free_bytes", "Free bytes of the disk with the data folder",
                               static_cast<double>(space.available)));
    try {
      const std::lock_guard lock(mutex_);
      if (measure_)
        for (const Metrics::Gauge& measured : measure_())
          families.push_back(gauge(measured.name, measured.help, measured.value));
    } catch (const std::exception&) {
      // A store that cannot be read says so elsewhere; here its numbers are missing, which no zero would say.
    }
    if (const double bytes = resident_bytes(); bytes > 0)
      families.push_back(gauge("process_resident_memory_bytes", "Memory of the daemon that is in use", bytes));
    return families;
  }

  void measure(std::function<std::vector<Metrics::Gauge>()> measure) {
    const std::lock_guard lock(mutex_);
    measure_ = std::move(measure);
  }

 private:
  static prometheus::MetricFamily gauge(const char* name, const char* help, double value) {
    prometheus::ClientMetric metric;
    metric.gauge.value = value;
    return {name, help, prometheus::MetricType::Gauge, {metric}};
  }
  static double resident_bytes() {
    long total = 0, resident = 0;
    std::ifstream("/proc/self/statm") >> total >> resident;
    return static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  }
  const std::filesystem::path data_;
  mutable std::mutex mutex_;
  std::function<std::vector<Metrics::Gauge>()> measure_;
};

struct Families {
  template <class Builder>
  auto& family(Builder builder, const char* name, const char* help) {
    return builder.Name(name).Help(help).Register(*registry);
  }
  const std::shared_ptr<prometheus::Registry> registry = std::make_shared<prometheus::Registry>();
};

class Metrics::Parts : public Families {
 public:
  std::shared_ptr<AtScrape> at_scrape;

  prometheus::Family<prometheus::Counter>& calls =
      family(prometheus::BuildCounter(), "saltusd_rpc_total", "Calls that have ended, or were turned away at the gate");
  prometheus::Family<prometheus::Histogram>& call_seconds =
      family(prometheus::BuildHistogram(), "saltusd_rpc_seconds", "From the arrival of a call to its end; streams too");
  prometheus::Family<prometheus::Gauge>& open_calls =
      family(prometheus::BuildGauge(), "saltusd_rpc_open", "Calls under way");
  prometheus::Counter& uploaded =
      family(prometheus::BuildCounter(), "saltusd_upload_bytes_total", "Bytes of blobs that came in").Add({});
  prometheus::Counter& downloaded =
      family(prometheus::BuildCounter(), "saltusd_download_bytes_total", "Bytes of blobs that went out").Add({});

  prometheus::Family<prometheus::Gauge>& jobs =
      family(prometheus::BuildGauge(), "saltusd_jobs", "Jobs that have not ended");
  prometheus::Counter& submitted =
      family(prometheus::BuildCounter(), "saltusd_jobs_submitted_total", "Jobs that were accepted").Add({});
  prometheus::Histogram& queue_seconds = family(prometheus::BuildHistogram(), "saltusd_queue_wait_seconds",
                                                "From the acceptance of a job to its first attempt")
                                             .Add({}, kJobSeconds);
  prometheus::Family<prometheus::Histogram>& job_seconds =
      family(prometheus::BuildHistogram(), "saltusd_job_seconds", "From the acceptance of a job to its end");
  prometheus::Counter& attempts =
      family(prometheus::BuildCounter(), "saltusd_attempts_started_total", "Attempts that were begun").Add({});
  prometheus::Family<prometheus::Counter>& attempts_ended =
      family(prometheus::BuildCounter(), "saltusd_attempts_total", "Attempts that have ended");
  prometheus::Counter& leases_lost =
      family(prometheus::BuildCounter(), "saltusd_lease_lost_total", "Attempts that were not heard of for too long")
          .Add({});

  prometheus::Histogram& commit_seconds = family(prometheus::BuildHistogram(), "saltusd_store_commit_seconds",
                                                 "Time of one commit of the database, its sync included")
                                              .Add({}, kCommitSeconds);
  prometheus::Histogram& group_sizes =
      family(prometheus::BuildHistogram(), "saltusd_store_group_size", "Changes that one commit has made durable")
          .Add({}, kGroupSizes);
  prometheus::Histogram& ping_seconds =
      family(prometheus::BuildHistogram(), "saltusd_callback_latency_seconds",
             "A call of the daemon to itself, every few seconds: high when something blocks gRPC's threads")
          .Add({}, kCallSeconds);

  // Last, so that nobody scrapes what is gone.
  std::unique_ptr<prometheus::Exposer> exposer;
};

Metrics::Metrics(const std::string& version, std::filesystem::path data) : parts_(std::make_unique<Parts>()) {
  parts_->at_scrape = std::make_shared<AtScrape>(std::move(data));
  parts_->family(prometheus::BuildGauge(), "saltusd_build_info", "1, with the version of the program")
      .Add({{"version", version}})
      .Set(1);
}

Metrics::~Metrics() = default;

int Metrics::serve(const std::string& host, int port) {
  const std::string address = host + ":" + std::to_string(port);
  try {
    parts_->exposer = std::make_unique<prometheus::Exposer>(address, 1);
  } catch (const std::exception&) {
    throw std::runtime_error("--metrics is " + address + ", where nothing can be served; see that the port is free");
  }
  parts_->exposer->RegisterCollectable(parts_->registry);
  parts_->exposer->RegisterCollectable(parts_->at_scrape);
  return parts_->exposer->GetListeningPorts().at(0);
}

std::string Metrics::text() const {
  auto families = parts_->registry->Collect();
  for (auto& family : parts_->at_scrape->Collect()) families.push_back(std::move(family));
  return prometheus::TextSerializer().Serialize(families);
}

void Metrics::at_scrape(std::function<std::vector<Gauge>()> measure) { parts_->at_scrape->measure(std::move(measure)); }

void Metrics::call_began(const std::string& method) { parts_->open_calls.Add({{"method", method}}).Increment(); }

void Metrics::call_ended(const CallRecord& call) {
  parts_->open_calls.Add({{"method", call.method}}).Decrement();
  parts_->calls.Add({{"method", call.method}, {"code", call.code}}).Increment();
  parts_->call_seconds.Add({{"method", call.method}}, kCallSeconds).Observe(Seconds(call.time).count());
}

void Metrics::call_denied(const CallRecord& call) {
  parts_->calls.Add({{"method", call.method}, {"code", call.code}}).Increment();
}

void Metrics::received_blob_bytes(std::size_t count) { parts_->uploaded.Increment(static_cast<double>(count)); }
void Metrics::sent_blob_bytes(std::size_t count) { parts_->downloaded.Increment(static_cast<double>(count)); }

void Metrics::job_stepped(const JobRecord& job, const JobStep& step) {
  const auto ended = [&](const std::string& outcome) {
    parts_->attempts_ended.Add({{"outcome", outcome}}).Increment();
  };
  switch (step.kind) {
    case JobStep::Kind::Queued:
      parts_->submitted.Increment();
      return;
    case JobStep::Kind::Started:
      parts_->attempts.Increment();
      if (job.attempt == 1 && job.started) parts_->queue_seconds.Observe(seconds_between(job.created, *job.started));
      return;
    case JobStep::Kind::Cancelling:
      return;
    case JobStep::Kind::Requeued:
      ended(step.has_lost_attempt ? "lost" : "released");
      break;
    case JobStep::Kind::Ended:
      if (job.ended)
        parts_->job_seconds.Add({{"outcome", to_string(job.state)}}, kJobSeconds)
            .Observe(seconds_between(job.created, *job.ended));
      if (job.attempt > 0) ended(step.has_lost_attempt ? "lost" : to_string(job.state));
      break;
  }
  if (step.has_lost_attempt && job.last_loss && job.last_loss->reason == "LEASE_EXPIRED")
    parts_->leases_lost.Increment();
}

void Metrics::jobs_are(int queued, int running, int cancelling) {
  parts_->jobs.Add({{"state", "queued"}}).Set(queued);
  parts_->jobs.Add({{"state", "running"}}).Set(running);
  parts_->jobs.Add({{"state", "cancelling"}}).Set(cancelling);
}

void Metrics::committed(std::chrono::steady_clock::duration time, std::size_t writes) {
  parts_->commit_seconds.Observe(Seconds(time).count());
  parts_->group_sizes.Observe(static_cast<double>(writes));
}

void Metrics::pinged(std::chrono::steady_clock::duration time) { parts_->ping_seconds.Observe(Seconds(time).count()); }

}  // namespace saltus::server
