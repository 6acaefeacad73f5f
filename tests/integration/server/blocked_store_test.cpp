#include "tests/integration/server/daemon_test.h"

#include <future>
#include <thread>

namespace saltus::server {
namespace {

/// Lets nothing through while it is closed.
class GatedStore final : public JobStore {
 public:
  GatedStore(std::unique_ptr<JobStore> inner, std::shared_future<void> gate)
      : inner_(std::move(inner)), gate_(std::move(gate)) {}
  void write(Operation operation, Done done) override {
    inner_->write(std::move(operation), [gate = gate_, done = std::move(done)](std::exception_ptr error) {
      gate.wait();
      done(error);
    });
  }
  void read(const std::function<void(JobReader&)>& operation) override {
    if (is_recovered_) gate_.wait();
    is_recovered_ = true;  // the first read is the daemon's own, before it listens
    inner_->read(operation);
  }

 private:
  std::unique_ptr<JobStore> inner_;
  std::shared_future<void> gate_;
  bool is_recovered_ = false;
};

class BlockedStore : public testing_support::DaemonTest {};

// gRPC has two callback threads on a small machine: one call that waits for the disk in each would stop all others.
TEST_F(BlockedStore, OtherCallsAreAnsweredWhileTheStoreIsBlocked) {
  std::promise<void> gate;
  DaemonParts parts;
  parts.launcher = make_launcher();
  parts.wrap_store = [opened = gate.get_future().share()](std::unique_ptr<JobStore> inner) {
    return std::make_unique<GatedStore>(std::move(inner), opened);
  };
  start(std::move(parts));

  constexpr int kBlocked = 12;  // more than there are threads of any kind
  std::vector<std::thread> blocked;
  for (int i = 0; i < kBlocked; ++i)
    blocked.emplace_back([this] {
      grpc::ClientContext context;
      v1::GetRegistrationJobRequest request;
      request.set_id("nobody");
      v1::RegistrationJob job;
      EXPECT_EQ(jobs->GetRegistrationJob(&context, request, &job).error_code(), grpc::StatusCode::NOT_FOUND);
    });
  for (int i = 0; i < 50; ++i) {
    grpc::ClientContext context;
    v1::ServerInfo answer;
    EXPECT_TRUE(info->GetServerInfo(&context, {}, &answer).ok());
    v1::HeartbeatResponse ignored;
    EXPECT_EQ(heartbeat({{"nobody", 1}, "token", 1}, 1, ignored).error_code(), grpc::StatusCode::ABORTED);
  }
  gate.set_value();
  for (auto& thread : blocked) thread.join();
}

}  // namespace
}  // namespace saltus::server
