// A client that pings too often is sent away, alone, and is welcome again when it behaves.
#include "tests/integration/server/daemon_test.h"

namespace saltus::server {
namespace {

class Keepalive : public testing_support::DaemonTest {
 protected:
  std::shared_ptr<grpc::Channel> pinging_every(int milliseconds) const {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, milliseconds);
    arguments.SetInt(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
    arguments.SetInt("grpc.http2.min_time_between_pings_ms", milliseconds);
    return grpc::CreateCustomChannel(daemon->address(), grpc::InsecureChannelCredentials(), arguments);
  }
  using Watch = std::unique_ptr<grpc::ClientReader<v1::WatchRegistrationJobResponse>>;
  static Watch watch(v1::RegistrationService::Stub& stub, grpc::ClientContext& context, const std::string& id) {
    v1::WatchRegistrationJobRequest request;
    request.set_id(id);
    Watch reader = stub.WatchRegistrationJob(&context, request);
    v1::WatchRegistrationJobResponse event;
    EXPECT_TRUE(reader->Read(&event));
    return reader;
  }
};

TEST_F(Keepalive, WhoPingsTooOftenIsSentAwayAloneAndMayComeBack) {
  start();
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  grpc::ClientContext good_context;
  const Watch good = watch(*jobs, good_context, job.id());

  const auto bad_jobs = v1::RegistrationService::NewStub(pinging_every(20));
  grpc::ClientContext bad_context;
  const Watch bad = watch(*bad_jobs, bad_context, job.id());
  v1::WatchRegistrationJobResponse event;
  EXPECT_FALSE(bad->Read(&event));
  const grpc::Status status = bad->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_NE(status.error_message().find("ping"), std::string::npos) << status.error_message();

  // As often as the client library does.
  const auto again = v1::RegistrationService::NewStub(pinging_every(30000));
  grpc::ClientContext again_context;
  const Watch welcome = watch(*again, again_context, job.id());
  ASSERT_TRUE(succeed(launch).ok());
  for (const auto& reader : {&good, &welcome}) {
    ASSERT_TRUE((*reader)->Read(&event));
    EXPECT_EQ(event.job().state(), v1::JOB_STATE_SUCCEEDED);
    EXPECT_FALSE((*reader)->Read(&event));
    EXPECT_TRUE((*reader)->Finish().ok());
  }
}

}  // namespace
}  // namespace saltus::server
