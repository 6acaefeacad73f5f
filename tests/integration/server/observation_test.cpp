// What the daemon tells of itself: numbers, log lines, and who has changed what.
#include "tests/integration/server/daemon_test.h"
#include "tests/support/scrape.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <mutex>

namespace saltus::server {
namespace {

using ::testing::HasSubstr;
using testing_support::content_of;
using testing_support::scraped;

class Observed : public testing_support::DaemonTest {
 protected:
  void SetUp() override {
    tune = [this](DaemonSettings& settings) {
      settings.metrics_port = 0;
      settings.dropped_log_lines = [] { return 17; };
      settings.log = [this](const LogLine& line) {
        std::lock_guard lock(mutex);
        logged.push_back(line);
      };
    };
    start();
  }

  double value(const std::string& line) const {
    const std::string text = "\n" + daemon->metrics().text();
    const auto at = text.find("\n" + line + " ");
    return at == std::string::npos ? 0 : std::stod(text.substr(at + line.size() + 2));
  }
  /// Calls are counted when all is over on the daemon's side, which may be a moment after the client has its answer.
  void wait_until(const std::string& line, double wanted) const {
    while (value(line) != wanted) {
    }
  }
  std::string audit() {
    daemon->flush_audit();
    return content_of(folder / "data/audit.log");
  }
  static std::string calls(const std::string& method, const std::string& code) {
    return "saltusd_rpc_total{code=\"" + code + "\",method=\"/saltus.v1." + method + "\"}";
  }

  std::mutex mutex;
  std::vector<LogLine> logged;
};

TEST_F(Observed, TheNumbersMoveAsTheyMust) {
  const auto first = created();
  wait_until(calls("RegistrationService/CreateRegistrationJob", "OK"), 1);
  wait_until(calls("BlobService/WriteBlob", "OK"), 2);
  EXPECT_EQ(value("saltusd_upload_bytes_total"), 11);  // "fixed", "moving"
  EXPECT_EQ(value("saltusd_jobs_submitted_total"), 1);
  const auto launch = launcher->wait_for_start(1);
  // The attempt may have begun a moment before it is told.
  wait_until("saltusd_jobs{state=\"running\"}", 1);
  wait_until("saltusd_attempts_started_total", 1);
  wait_until("saltusd_queue_wait_seconds_count", 1);
  created();
  EXPECT_EQ(value("saltusd_jobs{state=\"queued\"}"), 1);
  EXPECT_EQ(value("saltusd_blobs"), 2);
  EXPECT_EQ(value("saltusd_blob_bytes"), 11);
  EXPECT_EQ(value("saltusd_log_lines_dropped"), 17);

  v1::AcquireLeaseResponse lease;
  ASSERT_TRUE(acquire(launch, lease).ok());
  {
    grpc::ClientContext context;
    auto heartbeat = as_worker<v1::HeartbeatRequest>(launch);
    heartbeat.mutable_progress()->set_memory_bytes(5 << 20);
    heartbeat.mutable_progress()->set_cpu_seconds(1.5);
    v1::HeartbeatResponse response;
    ASSERT_TRUE(worker->Heartbeat(&context, heartbeat, &response).ok());
  }
  EXPECT_EQ(value("saltusd_worker_memory_bytes"), 5 << 20);
  EXPECT_EQ(value("saltusd_worker_cpu_seconds"), 1.5);
  ASSERT_TRUE(succeed(launch).ok());
  EXPECT_EQ(value("saltusd_worker_memory_bytes"), 0);
  EXPECT_EQ(value("saltusd_attempts_total{outcome=\"succeeded\"}"), 1);
  EXPECT_EQ(value("saltusd_job_seconds_count{outcome=\"succeeded\"}"), 1);
  EXPECT_GT(value("saltusd_store_commit_seconds_count"), 0);
  EXPECT_GE(value("saltusd_store_group_size_sum"), value("saltusd_store_group_size_count"));
  wait_until("saltusd_rpc_open{method=\"/saltus.v1.WorkerService/CompleteJob\"}", 0);

  {
    grpc::ClientContext context;
    v1::ReadBlobRequest request;
    request.set_digest(digest_of("field"));
    const auto reader = blobs->ReadBlob(&context, request);
    v1::ReadBlobResponse piece;
    while (reader->Read(&piece)) {
    }
    EXPECT_TRUE(reader->Finish().ok());
  }
  wait_until("saltusd_download_bytes_total", 5);
  while (value("saltusd_callback_latency_seconds_count") < 1) {
  }

  const std::string page = scraped(daemon->metrics_port());
  EXPECT_THAT(page, HasSubstr("200 OK"));
  for (const char* name : {"saltusd_rpc_total", "saltusd_rpc_seconds_bucket", "saltusd_jobs{", "saltusd_build_info",
                           "saltusd_disk_free_bytes", "process_resident_memory_bytes", "saltusd_upload_bytes_total 16"})
    EXPECT_THAT(page, HasSubstr(name));
  // Every line is a comment or "name{labels} number".
  std::istringstream lines(page.substr(page.find("\r\n\r\n") + 4));
  int samples = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line.front() == '#' || line == "\r") continue;
    EXPECT_THAT(line, ::testing::MatchesRegex("[a-z_]+([{].*[}])? [-+0-9.eInfNa]+\r?"));
    ++samples;
  }
  EXPECT_GT(samples, 50);
}

TEST_F(Observed, EveryChangeIsInTheAuditLogAndNothingElse) {
  const auto job = created();
  get(job.id());
  cancel(job.id());
  {
    grpc::ClientContext context;
    v1::CancelRegistrationJobRequest request;
    request.set_id("no-such-job-here");
    v1::RegistrationJob ignored;
    EXPECT_EQ(jobs->CancelRegistrationJob(&context, request, &ignored).error_code(), grpc::StatusCode::NOT_FOUND);
  }
  wait_until(calls("BlobService/WriteBlob", "OK"), 2);
  wait_until(calls("RegistrationService/CreateRegistrationJob", "OK"), 1);
  wait_until(calls("RegistrationService/CancelRegistrationJob", "OK"), 1);
  wait_until(calls("RegistrationService/CancelRegistrationJob", "NOT_FOUND"), 1);
  const std::string text = audit();
  EXPECT_THAT(text, HasSubstr("\"identity\":\"local\",\"peer\":\"local\",\"method\":\"/saltus.v1.RegistrationService/"
                              "CreateRegistrationJob\",\"code\":\"OK\",\"job\":\"" +
                              job.id() + "\"}\n"));
  EXPECT_THAT(text, HasSubstr("CancelRegistrationJob\",\"code\":\"OK\",\"job\":\"" + job.id()));
  EXPECT_THAT(text, HasSubstr("CancelRegistrationJob\",\"code\":\"NOT_FOUND\",\"job\":\"no-such-job-here"));
  EXPECT_THAT(text, HasSubstr("WriteBlob\",\"code\":\"OK\",\"blob\":\"" + digest_of("fixed")));
  EXPECT_THAT(text, ::testing::Not(HasSubstr("GetRegistrationJob")));
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 5);
}

TEST_F(Observed, LogLinesOfAJobCarryIdAttemptAndSubmitterAndNoLabel) {
  auto request = valid_request();
  (*request.mutable_labels())["patient"] = "PAT4711";
  request.set_request_id("DOE-JOHN");
  v1::RegistrationJob job;
  ASSERT_TRUE(create(request, job).ok());
  const auto launch = launcher->wait_for_start(1);
  v1::AcquireLeaseResponse lease;
  ASSERT_TRUE(acquire(launch, lease).ok());
  ASSERT_TRUE(succeed(launch).ok());
  for (const char* secret : {"PAT4711", "patient", "DOE-JOHN", launch.token.c_str()})
    EXPECT_THAT(audit() + daemon->metrics().text(), ::testing::Not(HasSubstr(secret)));
  std::lock_guard lock(mutex);
  for (const LogLine& line : logged)
    for (const char* secret : {"PAT4711", "patient", "DOE-JOHN", launch.token.c_str()})
      EXPECT_THAT(line.message, ::testing::Not(HasSubstr(secret)));
  const auto about = [&](const std::string& message) {
    for (const LogLine& line : logged)
      if (line.message == message) return line.job + " " + std::to_string(line.attempt) + " " + line.submitter;
    return std::string("nothing");
  };
  EXPECT_EQ(about("job is queued"), job.id() + " 0 local");
  EXPECT_EQ(about("attempt is started"), job.id() + " 1 local");
  EXPECT_EQ(about("job has succeeded"), job.id() + " 1 local");
}

// Every stage at which a client may hang up: the daemon must have let go of the call afterwards.
TEST_F(Observed, ThousandsOfCancelledCallsLeaveNothingBehind) {
  const auto job = created();
  for (int i = 0; i < 500; ++i) {
    {
      grpc::ClientContext context;
      v1::WatchRegistrationJobRequest request;
      request.set_id(job.id());
      const auto reader = jobs->WatchRegistrationJob(&context, request);
      v1::WatchRegistrationJobResponse event;
      if (i % 2 == 0) reader->Read(&event);
      context.TryCancel();
      reader->Finish();
    }
    {
      grpc::ClientContext context;
      v1::WriteBlobResponse response;
      const auto writer = blobs->WriteBlob(&context, &response);
      v1::WriteBlobRequest request;
      request.set_digest(digest_of(std::to_string(i)));
      request.set_size(100);
      request.set_data(std::string(i % 3, 'x'));
      if (i % 2 == 0) writer->Write(request);
      context.TryCancel();
      writer->Finish();
    }
    {
      grpc::ClientContext context;
      v1::ReadBlobRequest request;
      request.set_digest(digest_of("fixed"));
      const auto reader = blobs->ReadBlob(&context, request);
      v1::ReadBlobResponse piece;
      if (i % 2 == 0) reader->Read(&piece);
      context.TryCancel();
      reader->Finish();
    }
    {
      grpc::ClientContext context;
      context.set_deadline(std::chrono::system_clock::now());
      v1::RegistrationJob ignored;
      v1::GetRegistrationJobRequest request;
      request.set_id(job.id());
      jobs->GetRegistrationJob(&context, request, &ignored);
    }
  }
  for (const char* method : {"RegistrationService/WatchRegistrationJob", "BlobService/WriteBlob",
                             "BlobService/ReadBlob", "RegistrationService/GetRegistrationJob"})
    wait_until("saltusd_rpc_open{method=\"/saltus.v1." + std::string(method) + "\"}", 0);
  // All places are free again, and no upload has left its file.
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::WatchRegistrationJobResponse>>> watchers;
  for (int i = 0; i < 256; ++i) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    v1::WatchRegistrationJobRequest request;
    request.set_id(job.id());
    watchers.push_back(jobs->WatchRegistrationJob(contexts.back().get(), request));
    v1::WatchRegistrationJobResponse event;
    ASSERT_TRUE(watchers.back()->Read(&event)) << i;
  }
  EXPECT_EQ(value("saltusd_rpc_open{method=\"/saltus.v1.RegistrationService/WatchRegistrationJob\"}"), 256);
  for (auto& context : contexts) context->TryCancel();
}

}  // namespace
}  // namespace saltus::server
