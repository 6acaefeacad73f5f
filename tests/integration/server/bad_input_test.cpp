#include "server/rpc/limits.h"
#include "tests/integration/server/daemon_test.h"

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>

namespace saltus::server {
namespace {

using ::testing::HasSubstr;
using Request = v1::CreateRegistrationJobRequest;

struct Case {
  std::string name;
  std::function<void(Request&)> spoil;
  std::vector<std::string> said;  ///< the field, the value, the way out
  grpc::StatusCode code = grpc::StatusCode::INVALID_ARGUMENT;
  std::string reason = "INVALID_FIELD";
};

const std::string kAbsent = "sha256:" + std::string(64, 'a');

const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"no spec", [](Request& r) { r.clear_spec(); }, {"spec is not set", "say which images"}},
      {"no fixed", [](Request& r) { r.mutable_spec()->clear_fixed(); }, {"spec.fixed is not set", "upload"}},
      {"no moving", [](Request& r) { r.mutable_spec()->clear_moving(); }, {"spec.moving is not set", "upload"}},
      {"digest",
       [](Request& r) { r.mutable_spec()->mutable_fixed()->set_digest("abc"); },
       {"spec.fixed.digest is 'abc'", "64 lower-case hex digits"}},
      {"upper-case digest",
       [](Request& r) { r.mutable_spec()->mutable_moving()->set_digest("sha256:" + std::string(64, 'A')); },
       {"spec.moving.digest", "lower-case"}},
      {"absent input",
       [](Request& r) { r.mutable_spec()->mutable_fixed()->set_digest(kAbsent); },
       {kAbsent, "upload it"},
       grpc::StatusCode::FAILED_PRECONDITION,
       "INPUT_MISSING"},
      {"format",
       [](Request& r) { r.mutable_spec()->mutable_fixed()->set_format("mhd"); },
       {"spec.fixed.format is 'mhd'", "mha, nii, nii.gz, nrrd, png"}},
      {"mask format",
       [](Request& r) {
         *r.mutable_spec()->mutable_fixed_mask() = r.spec().fixed();
         r.mutable_spec()->mutable_fixed_mask()->set_format("csv");
       },
       {"spec.fixed_mask.format is 'csv'"}},
      {"moving mask digest",
       [](Request& r) { r.mutable_spec()->mutable_moving_mask()->set_format("mha"); },
       {"spec.moving_mask.digest is ''"}},
      {"one point file",
       [](Request& r) {
         *r.mutable_spec()->mutable_fixed_points() = r.spec().fixed();
         r.mutable_spec()->mutable_fixed_points()->set_format("csv");
       },
       {"spec.moving_points is not set", "both point files or none"}},
      {"point format",
       [](Request& r) {
         *r.mutable_spec()->mutable_fixed_points() = r.spec().fixed();
         *r.mutable_spec()->mutable_moving_points() = r.spec().moving();
       },
       {"spec.fixed_points.format is 'mha'", "csv"}},
      {"model", [](Request& r) { r.mutable_spec()->set_model("magic"); }, {"model is 'magic'", "sliding"}},
      {"similarity", [](Request& r) { r.mutable_spec()->set_similarity("magic"); }, {"similarity is 'magic'", "lncc"}},
      {"preset", [](Request& r) { r.mutable_spec()->set_preset("magic"); }, {"preset is 'magic'", "balanced"}},
      {"long model",
       [](Request& r) { r.mutable_spec()->set_model(std::string(5000, 'x')); },
       {"spec.model is 'xxx", "at most 128"}},
      {"setting name",
       [](Request& r) { (*r.mutable_spec()->mutable_settings())["magic"] = "1"; },
       {"'magic'", "--set help"}},
      {"setting value",
       [](Request& r) { (*r.mutable_spec()->mutable_settings())["time_steps"] = "-1"; },
       {"time_steps is '-1'", "must be"}},
      {"setting value with control characters",
       [](Request& r) { (*r.mutable_spec()->mutable_settings())["time_steps"] = "1\n2"; },
       {"time_steps", "'1?2'", "printable"}},
      {"settings together",
       [](Request& r) {
         (*r.mutable_spec()->mutable_settings())["levels"] = "3";
         (*r.mutable_spec()->mutable_settings())["finest_level"] = "4";
       },
       {"finest_level is 4", "less than levels"}},
      {"setting that the model has no use for",
       [](Request& r) {
         r.mutable_spec()->set_model("wendland1");
         (*r.mutable_spec()->mutable_settings())["first_order_kernel_widths"] = "5:1";
       },
       {"first_order_kernel_widths is 5:1", "wendland1", "set it to none"}},
      {"affine",
       [](Request& r) { r.mutable_spec()->set_affine(static_cast<v1::AffineStart>(9)); },
       {"spec.affine is 9", "rigid"}},
      {"window",
       [](Request& r) {
         r.mutable_spec()->mutable_intensity_window()->set_low(5);
         r.mutable_spec()->mutable_intensity_window()->set_high(5);
       },
       {"spec.intensity_window is 5,5", "low must be less than high"}},
      {"infinite window",
       [](Request& r) { r.mutable_spec()->mutable_intensity_window()->set_high(HUGE_VAL); },
       {"spec.intensity_window", "finite"}},
      {"NaN window",
       [](Request& r) { r.mutable_spec()->mutable_intensity_window()->set_low(NAN); },
       {"spec.intensity_window", "finite"}},
      {"crop axes",
       [](Request& r) { r.mutable_spec()->mutable_crop()->add_begin(1); },
       {"spec.crop is [1] to []", "2 or both have 3"}},
      {"crop order",
       [](Request& r) {
         auto* crop = r.mutable_spec()->mutable_crop();
         for (const int b : {0, 5}) crop->add_begin(b);
         for (const int e : {4, 5}) crop->add_end(e);
       },
       {"spec.crop is [0,5] to [4,5]", "less than end"}},
      {"crop below 0",
       [](Request& r) {
         auto* crop = r.mutable_spec()->mutable_crop();
         for (const int b : {0, -1}) crop->add_begin(b);
         for (const int e : {4, 5}) crop->add_end(e);
       },
       {"spec.crop is [0,-1]", "at least 0"}},
      {"output format",
       [](Request& r) { r.mutable_spec()->set_output_format("png"); },
       {"spec.output_format is 'png'", "mha, nii.gz, nrrd"}},
      {"threads", [](Request& r) { r.mutable_spec()->set_threads(-1); }, {"spec.threads is -1", "0"}},
      {"too many threads", [](Request& r) { r.mutable_spec()->set_threads(257); }, {"spec.threads is 257", "256"}},
      {"request id", [](Request& r) { r.set_request_id(std::string(37, 'x')); }, {"request_id is 'xxx", "at most 36"}},
      {"request id with line break",
       [](Request& r) { r.set_request_id("a\nb"); },
       {"request_id is 'a?b'", "printable"}},
      {"label name", [](Request& r) { (*r.mutable_labels())["a b"] = ""; }, {"labels is 'a b'", "letters, digits"}},
      {"label value",
       [](Request& r) { (*r.mutable_labels())["a"] = std::string(257, 'x'); },
       {"labels[a]", "at most 256"}},
      {"many labels",
       [](Request& r) {
         for (int i = 0; i < 33; ++i) (*r.mutable_labels())["l" + std::to_string(i)] = "";
       },
       {"labels is a list of 33", "at most 32"}},
  };
  return all;
}

class BadInput : public testing_support::DaemonTest {
 protected:
  void SetUp() override { start(); }

  template <class Response, class Ask, class Method>
  void expect_refused(Method method, const Ask& request, grpc::StatusCode code, const std::string& said) {
    grpc::ClientContext context;
    Response response;
    const auto status = (jobs.get()->*method)(&context, request, &response);
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr(said));
  }
};

TEST_F(BadInput, CreateNamesTheFieldTheValueAndTheWayOut) {
  const Request valid = valid_request();
  for (const Case& bad : cases()) {
    SCOPED_TRACE(bad.name);
    Request request = valid;
    bad.spoil(request);
    grpc::ClientContext context;
    v1::RegistrationJob job;
    const auto status = jobs->CreateRegistrationJob(&context, request, &job);
    EXPECT_EQ(status.error_code(), bad.code) << status.error_message();
    for (const std::string& said : bad.said) EXPECT_THAT(status.error_message(), HasSubstr(said));
    EXPECT_EQ(testing_support::reason_of(context), bad.reason);
  }
  grpc::ClientContext context;
  v1::ListRegistrationJobsResponse list;
  ASSERT_TRUE(jobs->ListRegistrationJobs(&context, {}, &list).ok());
  EXPECT_EQ(list.jobs_size(), 0);
}

TEST_F(BadInput, EverythingThatIsOptionalMayBeGiven) {
  Request request = valid_request();
  auto* spec = request.mutable_spec();
  *spec->mutable_fixed_mask() = spec->fixed();
  *spec->mutable_moving_mask() = spec->moving();
  *spec->mutable_fixed_points() = spec->fixed();
  *spec->mutable_moving_points() = spec->moving();
  spec->mutable_fixed_points()->set_format("csv");
  spec->mutable_moving_points()->set_format("csv");
  spec->set_model("wendland1");
  spec->set_similarity("ssd");
  spec->set_preset("fast");
  (*spec->mutable_settings())["time_steps"] = "5";
  spec->set_affine(v1::AFFINE_START_RIGID);
  spec->mutable_intensity_window()->set_low(-100);
  spec->mutable_intensity_window()->set_high(100);
  for (const int b : {0, 1, 2}) spec->mutable_crop()->add_begin(b);
  for (const int e : {4, 5, 6}) spec->mutable_crop()->add_end(e);
  spec->set_output_format("nrrd");
  spec->set_threads(2);
  request.set_request_id("me");
  (*request.mutable_labels())["study"] = "liver é";
  v1::RegistrationJob job;
  const auto status = create(request, job);
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(job.spec().SerializeAsString().size(), request.spec().SerializeAsString().size());
  EXPECT_EQ(job.labels().at("study"), "liver é");
}

TEST_F(BadInput, UnknownJobsAreNotFound) {
  v1::GetRegistrationJobRequest get_request;
  get_request.set_id("0199-abc");
  expect_refused<v1::RegistrationJob>(&v1::RegistrationService::Stub::GetRegistrationJob, get_request,
                                      grpc::StatusCode::NOT_FOUND, "there is no job '0199-abc'");
  get_request.set_id("../x");
  expect_refused<v1::RegistrationJob>(&v1::RegistrationService::Stub::GetRegistrationJob, get_request,
                                      grpc::StatusCode::INVALID_ARGUMENT, "id is '../x'");
  v1::CancelRegistrationJobRequest cancel_request;
  cancel_request.set_id("0199-abc");
  expect_refused<v1::RegistrationJob>(&v1::RegistrationService::Stub::CancelRegistrationJob, cancel_request,
                                      grpc::StatusCode::NOT_FOUND, "there is no job");
  EXPECT_EQ(remove("0199-abc").error_code(), grpc::StatusCode::NOT_FOUND);
  grpc::ClientContext context;
  v1::WatchRegistrationJobRequest watch_request;
  watch_request.set_id("0199-abc");
  const auto watch = jobs->WatchRegistrationJob(&context, watch_request);
  v1::WatchRegistrationJobResponse event;
  EXPECT_FALSE(watch->Read(&event));
  EXPECT_EQ(watch->Finish().error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(BadInput, PagesMustBeThoseThatWereGiven) {
  created();
  created();
  v1::ListRegistrationJobsRequest request;
  const auto method = &v1::RegistrationService::Stub::ListRegistrationJobs;
  using Response = v1::ListRegistrationJobsResponse;
  request.set_page_size(-1);
  expect_refused<Response>(method, request, grpc::StatusCode::INVALID_ARGUMENT, "page_size is -1");
  request.set_page_size(1);
  for (const char* token : {"x", "0-", "0-x", "0--5", "0-99999999999999999999", "1-1"}) {
    request.set_page_token(token);
    expect_refused<Response>(method, request, grpc::StatusCode::INVALID_ARGUMENT, "page_token");
  }
  request.clear_page_token();
  grpc::ClientContext context;
  Response page;
  ASSERT_TRUE(jobs->ListRegistrationJobs(&context, request, &page).ok());
  request.set_page_token(page.next_page_token());
  request.set_state(v1::JOB_STATE_FAILED);
  expect_refused<Response>(method, request, grpc::StatusCode::INVALID_ARGUMENT, "page_token");
  request.clear_page_token();
  request.set_state(static_cast<v1::JobState>(77));
  expect_refused<Response>(method, request, grpc::StatusCode::INVALID_ARGUMENT, "state is 77");
}

TEST_F(BadInput, UploadsMustSayWhatTheyAre) {
  EXPECT_THAT(upload("x", "md5:abc").error_message(), HasSubstr("digest is 'md5:abc'"));
  const auto first = [&](std::int64_t size) {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    const auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest request;
    request.set_digest(kAbsent);
    request.set_size(size);
    writer->Write(request);
    return writer->Finish();
  };
  EXPECT_THAT(first(-1).error_message(), HasSubstr("size is -1"));
  EXPECT_THAT(first(limits::kBlobBytes + 1).error_message(), HasSubstr("size is 8589934593"));
  grpc::ClientContext context;
  v1::WriteBlobResponse response;
  const auto writer = blobs->WriteBlob(&context, &response);
  writer->WritesDone();
  const auto status = writer->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("first message"));
}

TEST_F(BadInput, WorkersMayNotNameFilesFreely) {
  created();
  const auto launch = launcher->wait_for_start(1);
  for (const std::string name : {"", "../x", "a/b", ".hidden", "a b", "."}) {
    auto request = as_worker<v1::CompleteJobRequest>(launch);
    auto* artifact = request.mutable_success()->add_artifacts();
    artifact->set_name(name);
    artifact->set_digest(kAbsent);
    const auto status = complete(request);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << name;
    EXPECT_THAT(status.error_message(), HasSubstr("plain file name"));
  }
  EXPECT_THAT(complete(as_worker<v1::CompleteJobRequest>(launch)).error_message(), HasSubstr("outcome is not set"));
}

// The callback API of gRPC answers bytes that are no message by itself; the README says so.
TEST_F(BadInput, BytesThatAreNoMessageAreUnimplemented) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const grpc::Slice garbage("\xff\xff\xff\xff\xff");
  const grpc::ByteBuffer request(&garbage, 1);
  const auto call =
      stub.PrepareUnaryCall(&context, "/saltus.v1.RegistrationService/GetRegistrationJob", request, &queue);
  call->StartCall();
  grpc::ByteBuffer response;
  grpc::Status status;
  call->Finish(&response, &status, nullptr);
  void* tag = nullptr;
  bool is_ok = false;
  ASSERT_TRUE(queue.Next(&tag, &is_ok));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED);
}

TEST_F(BadInput, TheLimitsAreTold) {
  grpc::ClientContext context;
  v1::ServerInfo answer;
  ASSERT_TRUE(info->GetServerInfo(&context, {}, &answer).ok());
  EXPECT_EQ(answer.version(), "1.2.3");
  EXPECT_THAT(answer.models(), ::testing::Contains("sliding"));
  EXPECT_THAT(answer.formats(), ::testing::Contains("nii.gz"));
  EXPECT_EQ(answer.max_blob_bytes(), limits::kBlobBytes);
  EXPECT_EQ(answer.max_message_bytes(), limits::kMessageBytes);
  EXPECT_EQ(answer.worker_slots(), 1);
}

}  // namespace
}  // namespace saltus::server
