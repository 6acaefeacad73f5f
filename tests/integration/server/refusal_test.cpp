// Every way in which the daemon refuses a call: its code, its reason, and whether trying again may help.
#include "tests/integration/server/daemon_test.h"
#include "tests/support/certificates.h"
#include "tests/support/fake_disk.h"

#include "saltus/v1/admin.grpc.pb.h"

#include <gmock/gmock.h>
#include <grpcpp/security/credentials.h>

#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <thread>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;
using grpc::StatusCode;
using testing_support::content_of;

/// What a refused call answers.
struct Answer {
  StatusCode code;
  std::string reason;
  std::string retry_after_ms;  ///< "" when it says nothing of trying again
  bool has_retry_info = false;
};

class Refusals : public testing_support::DaemonTest {
 protected:
  Refusals() {
    on_broken = [](const std::string&) {};
  }

  void begin() {
    DaemonParts parts;
    parts.disk = disk;
    start(std::move(parts));
  }
  static Answer answer_of(const grpc::ClientContext& context, const grpc::Status& status) {
    return {status.error_code(), testing_support::reason_of(context),
            testing_support::trailer_of(context, "saltus-retry-after-ms"),
            status.error_details().find("google.rpc.RetryInfo") != std::string::npos};
  }
  template <class Call>
  static Answer answer_to(Call call) {
    grpc::ClientContext context;
    const grpc::Status status = call(context);
    return answer_of(context, status);
  }
  Answer creating(const v1::CreateRegistrationJobRequest& request) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::RegistrationJob job;
      return jobs->CreateRegistrationJob(&context, request, &job);
    });
  }
  Answer getting(const std::string& id) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::GetRegistrationJobRequest request;
      request.set_id(id);
      v1::RegistrationJob job;
      return jobs->GetRegistrationJob(&context, request, &job);
    });
  }
  Answer deleting(const std::string& id) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::DeleteRegistrationJobRequest request;
      request.set_id(id);
      v1::DeleteRegistrationJobResponse response;
      return jobs->DeleteRegistrationJob(&context, request, &response);
    });
  }
  Answer listing(const std::string& page_token) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::ListRegistrationJobsRequest request;
      request.set_page_token(page_token);
      v1::ListRegistrationJobsResponse response;
      return jobs->ListRegistrationJobs(&context, request, &response);
    });
  }
  Answer uploading(const v1::WriteBlobRequest& first, const std::string& content) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::WriteBlobResponse response;
      const auto writer = blobs->WriteBlob(&context, &response);
      v1::WriteBlobRequest request = first;
      request.set_data(content);
      writer->Write(request);
      writer->WritesDone();
      return writer->Finish();
    });
  }
  Answer downloading(const std::string& digest, std::int64_t offset = 0) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::ReadBlobRequest request;
      request.set_digest(digest);
      request.set_offset(offset);
      const auto reader = blobs->ReadBlob(&context, request);
      for (v1::ReadBlobResponse response; reader->Read(&response);) continue;
      return reader->Finish();
    });
  }
  Answer completing(const v1::CompleteJobRequest& request) {
    return answer_to([&](grpc::ClientContext& context) {
      v1::CompleteJobResponse response;
      return worker->CompleteJob(&context, request, &response);
    });
  }
  /// An attempt to work on.
  LaunchRequest running() {
    created();
    return launcher->wait_for_start(1);
  }

  std::shared_ptr<testing_support::FakeDisk> disk = std::make_shared<testing_support::FakeDisk>();

  // Each brings about one refusal, on a daemon of its own.

  Answer invalid_field() {
    begin();
    return creating({});
  }
  Answer bad_page_token() {
    begin();
    return listing("seven");
  }
  Answer digest_mismatch() {
    begin();
    return uploading(announcement("good"), "evil");
  }
  Answer size_mismatch() {
    begin();
    return uploading(announcement("good"), "go");
  }
  Answer job_not_found() {
    begin();
    return getting("0190a0a0-0000-7000-8000-000000000000");
  }
  Answer blob_not_found() {
    begin();
    return downloading(digest_of("nothing"));
  }
  Answer request_id_reused() {
    begin();
    auto request = valid_request();
    request.set_request_id("0b6a4b1e-0000-4000-8000-000000000001");
    EXPECT_EQ(creating(request).code, StatusCode::OK);
    (*request.mutable_labels())["case"] = "other";
    return creating(request);
  }
  Answer input_missing() {
    begin();
    auto request = valid_request();
    request.mutable_spec()->mutable_fixed()->set_digest(digest_of("never sent"));
    return creating(request);
  }
  Answer job_running() {
    begin();
    return deleting(running().key.job_id);
  }
  Answer artifact_missing() {
    begin();
    auto request = as_worker<v1::CompleteJobRequest>(running());
    auto& artifact = *request.mutable_success()->add_artifacts();
    artifact.set_name("displacement.mha");
    artifact.set_digest(digest_of("never sent"));
    artifact.set_size(10);
    return completing(request);
  }
  Answer checkpoint_missing() {
    begin();
    auto request = as_worker<v1::PutCheckpointRequest>(running());
    request.mutable_checkpoint()->set_digest(digest_of("never sent"));
    request.mutable_checkpoint()->set_size(10);
    return answer_to([&](grpc::ClientContext& context) {
      v1::PutCheckpointResponse response;
      return worker->PutCheckpoint(&context, request, &response);
    });
  }
  Answer exceeds_budget() {
    job_settings.thread_budget = 2;
    begin();
    auto request = valid_request();
    request.mutable_spec()->set_threads(3);
    return creating(request);
  }
  Answer queue_full() {
    job_settings.queue.max_queued = 1;
    begin();
    running();
    created();
    return creating(valid_request());
  }
  Answer quota() {
    job_settings.queue.max_queued_of_submitter = 1;
    // Callers on this machine are not told apart, so they have no quota.
    const testing_support::Authority authority;
    const auto certificate = authority.server(), ann = authority.issue("ann");
    folder.write("ca.pem", authority.root.pem());
    folder.write("server.pem", certificate.pem());
    folder.write("server.key", certificate.key_pem());
    folder.write("roles", "ann = submitter\n");
    tune = [this](DaemonSettings& settings) {
      settings.protected_listen = {{ListenAddress::Kind::Protected, "", "127.0.0.1", 0}};
      settings.tls = {folder / "server.pem", folder / "server.key", folder / "ca.pem", std::chrono::seconds(1)};
      settings.roles = folder / "roles";
    };
    begin();
    running();
    const auto request = valid_request();
    jobs = v1::RegistrationService::NewStub(grpc::CreateChannel(
        daemon->protected_addresses().at(0), grpc::SslCredentials({authority.root.pem(), ann.key_pem(), ann.pem()})));
    EXPECT_EQ(creating(request).code, StatusCode::OK);
    return creating(request);
  }
  Answer too_many_streams() {
    begin();
    struct Stream {
      grpc::ClientContext context;
      v1::WriteBlobResponse response;
      std::unique_ptr<grpc::ClientWriter<v1::WriteBlobRequest>> writer;
    };
    std::vector<std::unique_ptr<Stream>> streams;
    Answer answer{StatusCode::OK, "", ""};
    // Those that are let in stay open and say nothing; the first that is not ends at once.
    for (int i = 0; i < 17; ++i) {
      auto& stream = *streams.emplace_back(std::make_unique<Stream>());
      const std::string content = "upload " + std::to_string(i);
      stream.writer = blobs->WriteBlob(&stream.context, &stream.response);
      stream.writer->Write(announcement(content));
      if (i < 16) wait_for_part(static_cast<std::size_t>(i) + 1);
    }
    const grpc::Status status = streams.back()->writer->Finish();
    answer = answer_of(streams.back()->context, status);
    streams.pop_back();
    for (auto& stream : streams) {
      stream->context.TryCancel();
      stream->writer->Finish();
    }
    return answer;
  }
  void wait_for_part(std::size_t count) {
    const auto parts = [&] {
      return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder / "data/uploads"), {}));
    };
    while (parts() < count) std::this_thread::yield();
  }
  Answer storage_full() {
    begin();
    disk->total = 1000;
    disk->available = 1;
    return uploading(announcement("good"), "good");
  }
  Answer file_too_large() {
    begin();
    disk->write_error = EFBIG;
    return uploading(announcement("good"), "good");
  }
  Answer draining() {
    begin();
    const auto request = valid_request();
    const auto admin = v1::AdminService::NewStub(channel);
    grpc::ClientContext context;
    v1::DrainResponse response;
    EXPECT_TRUE(admin->Drain(&context, {}, &response).ok());
    return creating(request);
  }
  Answer store_unavailable() {
    begin();
    disk->sync_error = EIO;
    uploading(announcement("lost"), "lost");
    return uploading(announcement("good"), "good");
  }
  Answer lease_lost() {
    begin();
    auto request = as_worker<v1::CompleteJobRequest>(running());
    request.set_token("another");
    request.mutable_cancelled();
    return completing(request);
  }
  Answer offset_mismatch() {
    begin();
    return uploading(announcement("good", 2), "od");
  }
  Answer upload_taken_over() {
    begin();
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    const auto first = blobs->WriteBlob(&context, &response);
    first->Write(announcement("good"));
    wait_for_part(1);
    EXPECT_EQ(uploading(announcement("good"), "go").reason, "SIZE_MISMATCH");
    v1::WriteBlobRequest request;
    request.set_data("good");
    first->Write(request);
    first->WritesDone();
    const grpc::Status status = first->Finish();
    return answer_of(context, status);
  }
  Answer offset_beyond_end() {
    begin();
    return downloading(uploaded("good"), 5);
  }
  Answer blob_corrupt() {
    begin();
    const std::string digest = uploaded("good");
    disk->read_error = EIO;
    return downloading(digest);
  }
};

struct Row {
  const char* reason;
  StatusCode code;
  bool is_worth_retrying;  ///< the same call may be granted later, without anybody changing it
  Answer (Refusals::*provoke)();
};

class EveryRefusal : public Refusals, public ::testing::WithParamInterface<Row> {
 public:
  static std::vector<Row> table() {
    return {
        {"INVALID_FIELD", StatusCode::INVALID_ARGUMENT, false, &EveryRefusal::invalid_field},
        {"BAD_PAGE_TOKEN", StatusCode::INVALID_ARGUMENT, false, &EveryRefusal::bad_page_token},
        {"DIGEST_MISMATCH", StatusCode::INVALID_ARGUMENT, false, &EveryRefusal::digest_mismatch},
        {"SIZE_MISMATCH", StatusCode::INVALID_ARGUMENT, false, &EveryRefusal::size_mismatch},
        {"JOB_NOT_FOUND", StatusCode::NOT_FOUND, false, &EveryRefusal::job_not_found},
        {"BLOB_NOT_FOUND", StatusCode::NOT_FOUND, false, &EveryRefusal::blob_not_found},
        {"REQUEST_ID_REUSED", StatusCode::ALREADY_EXISTS, false, &EveryRefusal::request_id_reused},
        {"INPUT_MISSING", StatusCode::FAILED_PRECONDITION, false, &EveryRefusal::input_missing},
        {"JOB_RUNNING", StatusCode::FAILED_PRECONDITION, false, &EveryRefusal::job_running},
        {"ARTIFACT_MISSING", StatusCode::FAILED_PRECONDITION, false, &EveryRefusal::artifact_missing},
        {"CHECKPOINT_MISSING", StatusCode::FAILED_PRECONDITION, false, &EveryRefusal::checkpoint_missing},
        {"EXCEEDS_BUDGET", StatusCode::FAILED_PRECONDITION, false, &EveryRefusal::exceeds_budget},
        {"FILE_TOO_LARGE", StatusCode::FAILED_PRECONDITION, false, &EveryRefusal::file_too_large},
        {"QUEUE_FULL", StatusCode::RESOURCE_EXHAUSTED, true, &EveryRefusal::queue_full},
        {"QUOTA", StatusCode::RESOURCE_EXHAUSTED, true, &EveryRefusal::quota},
        {"TOO_MANY_STREAMS", StatusCode::RESOURCE_EXHAUSTED, true, &EveryRefusal::too_many_streams},
        {"STORAGE_FULL", StatusCode::RESOURCE_EXHAUSTED, true, &EveryRefusal::storage_full},
        {"DRAINING", StatusCode::UNAVAILABLE, true, &EveryRefusal::draining},
        {"STORE_UNAVAILABLE", StatusCode::UNAVAILABLE, true, &EveryRefusal::store_unavailable},
        {"LEASE_LOST", StatusCode::ABORTED, false, &EveryRefusal::lease_lost},
        {"OFFSET_MISMATCH", StatusCode::ABORTED, false, &EveryRefusal::offset_mismatch},
        {"UPLOAD_TAKEN_OVER", StatusCode::ABORTED, false, &EveryRefusal::upload_taken_over},
        {"OFFSET_BEYOND_END", StatusCode::OUT_OF_RANGE, false, &EveryRefusal::offset_beyond_end},
        {"BLOB_CORRUPT", StatusCode::DATA_LOSS, false, &EveryRefusal::blob_corrupt},
    };
  }
};

TEST_P(EveryRefusal, SaysWhetherTryingAgainMayHelp) {
  const Row& row = GetParam();
  const Answer answer = (this->*row.provoke)();
  EXPECT_EQ(answer.reason, row.reason);
  EXPECT_EQ(answer.code, row.code);
  EXPECT_EQ(answer.has_retry_info, row.is_worth_retrying);
  EXPECT_EQ(!answer.retry_after_ms.empty(), row.is_worth_retrying);
  if (row.is_worth_retrying) {
    EXPECT_GT(std::stol(answer.retry_after_ms), 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Table, EveryRefusal, ::testing::ValuesIn(EveryRefusal::table()),
                         [](const auto& info) { return std::string(info.param.reason); });

// The table above has them all, and so has the documentation. Not in it: what a client that has gone can never hear,
// and what the rules of who may do what answer (access_test).
TEST(RefusalTable, HasEveryReasonOfTheSourcesAndOfTheDocumentation) {
  std::set<std::string> tested;
  for (const Row& row : EveryRefusal::table()) tested.insert(row.reason);

  const fs::path server = SALTUS_SERVER_FOLDER;
  std::set<std::string> thrown;
  const std::regex refusal(R"(RefusalKind::\w+,\s*"([A-Z_]+)\")");
  for (const auto& entry : fs::recursive_directory_iterator(server)) {
    if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
    const std::string source = content_of(entry.path());
    for (std::sregex_iterator match(source.begin(), source.end(), refusal), end; match != end; ++match)
      thrown.insert((*match)[1]);
  }
  for (const char* unheard : {"WATCHER_GONE", "ROLE_LACKS_RIGHT"}) thrown.erase(unheard);
  EXPECT_EQ(thrown, tested);

  std::set<std::string> documented;
  std::istringstream readme(content_of(server / "README.md"));
  const std::regex row(R"(\| [A-Z_]+ \| ([A-Z_]+(?:, [A-Z_]+)*) \|)"), word("[A-Z_]+");
  for (std::string line; std::getline(readme, line);) {
    std::smatch match;
    if (!std::regex_match(line, match, row)) continue;
    const std::string reasons = match[1];
    for (std::sregex_iterator reason(reasons.begin(), reasons.end(), word), end; reason != end; ++reason)
      documented.insert(reason->str());
  }
  for (const char* of_the_gate : {"ROLE_LACKS_RIGHT", "NO_IDENTITY"}) EXPECT_EQ(documented.erase(of_the_gate), 1u);
  EXPECT_EQ(documented, tested);
}

}  // namespace
}  // namespace saltus::server
