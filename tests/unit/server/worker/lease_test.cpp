#include "server/worker/lease.h"

#include "client/lib/client_error.h"
#include "tests/support/fake_daemon.h"

#include <condition_variable>
#include <deque>
#include <future>
#include <optional>

namespace saltus::worker {
namespace {

/// Answers heartbeats as told and keeps them for the test to wait for.
class FakeWorkers : public v1::WorkerService::Service {
 public:
  double lease_seconds = 60;
  std::string good_token = "secret";

  void answer_with(v1::HeartbeatResponse::Command command, grpc::Status status = grpc::Status::OK) {
    std::lock_guard lock(mutex_);
    command_ = command;
    status_ = status;
  }
  /// Waits for the first heartbeat that `matches`. Throws when none comes for very long.
  v1::HeartbeatRequest wait_for_heartbeat(const std::function<bool(const v1::HeartbeatRequest&)>& matches) {
    std::unique_lock lock(mutex_);
    while (true) {
      for (; !heartbeats_.empty(); heartbeats_.pop_front())
        if (matches(heartbeats_.front())) return heartbeats_.front();
      if (changed_.wait_for(lock, std::chrono::seconds(60)) == std::cv_status::timeout)
        throw std::runtime_error("no heartbeat came");
    }
  }
  std::vector<v1::CompleteJobRequest> outcomes;
  int refused_completions = 0, unanswered_heartbeats = 0;

  grpc::Status AcquireLease(grpc::ServerContext*, const v1::AcquireLeaseRequest* request,
                            v1::AcquireLeaseResponse* response) override {
    if (request->token() != good_token) return {grpc::StatusCode::ABORTED, "the attempt is no longer wanted"};
    response->mutable_spec()->set_model("sliding");
    response->set_threads(2);
    response->set_lease_seconds(lease_seconds);
    response->set_heartbeat_interval_seconds(0.02);
    return grpc::Status::OK;
  }
  grpc::Status Heartbeat(grpc::ServerContext* context, const v1::HeartbeatRequest* request,
                         v1::HeartbeatResponse* response) override {
    std::unique_lock lock(mutex_);
    if (unanswered_heartbeats > 0) {  // until the worker gives up
      --unanswered_heartbeats;
      while (!changed_.wait_for(lock, std::chrono::milliseconds(10), [&] { return context->IsCancelled(); })) continue;
      return grpc::Status::CANCELLED;
    }
    heartbeats_.push_back(*request);
    changed_.notify_all();
    response->set_command(command_);
    return status_;
  }
  grpc::Status CompleteJob(grpc::ServerContext*, const v1::CompleteJobRequest* request,
                           v1::CompleteJobResponse*) override {
    std::lock_guard lock(mutex_);
    if (refused_completions-- > 0) return {grpc::StatusCode::UNAVAILABLE, "not yet"};
    outcomes.push_back(*request);
    return grpc::Status::OK;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<v1::HeartbeatRequest> heartbeats_;
  v1::HeartbeatResponse::Command command_ = v1::HeartbeatResponse::COMMAND_CONTINUE;
  grpc::Status status_;
};

class LeaseTest : public testing::Test {
 protected:
  AttemptIdentity identity(const std::string& token = "secret") const {
    return {daemon->settings().address, {}, "job-1", 3, token, ""};
  }
  /// Waits until work would have been told to stop for so long that the process has to be ended.
  StopReason reason_when_late(const std::function<void(Lease&)>& during) {
    std::promise<StopReason> reason;
    bool is_told = false;
    Lease lease(identity(), [&](Lease& late) {
      if (!std::exchange(is_told, true)) reason.set_value(late.stop_reason());
    });
    during(lease);
    return reason.get_future().get();
  }

  FakeWorkers service;
  std::optional<testing_support::FakeDaemon> daemon{std::in_place, std::initializer_list<grpc::Service*>{&service}};
};

TEST_F(LeaseTest, TurnsTheTokenIntoTheTermsOfTheJob) {
  Lease lease(identity(), [](Lease&) {});
  EXPECT_EQ(lease.terms().spec().model(), "sliding");
  EXPECT_EQ(lease.terms().threads(), 2);
  EXPECT_EQ(lease.stop_reason(), StopReason::None);
}

TEST_F(LeaseTest, IsRefusedWithAnotherToken) {
  try {
    Lease lease(identity("stolen"), [](Lease&) {});
    FAIL() << "no error";
  } catch (const client::ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::ABORTED);
  }
}

TEST_F(LeaseTest, SendsTheLatestProgressWithIdentityAndToken) {
  Lease lease(identity(), [](Lease&) {});
  v1::JobProgress progress;
  progress.set_iteration(17);
  lease.set_progress(progress);
  const auto heartbeat =
      service.wait_for_heartbeat([](const v1::HeartbeatRequest& beat) { return beat.progress().iteration() == 17; });
  EXPECT_EQ(heartbeat.job_id(), "job-1");
  EXPECT_EQ(heartbeat.attempt(), 3);
  EXPECT_EQ(heartbeat.token(), "secret");
}

TEST_F(LeaseTest, CutsTransfersOffWhenTheDaemonCancels) {
  Lease lease(identity(), [](Lease&) {});
  std::promise<void> stopped;
  std::stop_callback on_stop(lease.transfer_settings().stop, [&stopped] { stopped.set_value(); });
  service.answer_with(v1::HeartbeatResponse::COMMAND_CANCEL);
  stopped.get_future().wait();
  EXPECT_EQ(lease.stop_reason(), StopReason::Cancelled);
}

TEST_F(LeaseTest, IsLostWhenTheDaemonAborts) {
  EXPECT_EQ(reason_when_late([this](Lease&) {
              service.answer_with(v1::HeartbeatResponse::COMMAND_UNSPECIFIED,
                                  grpc::Status(grpc::StatusCode::ABORTED, "another attempt runs"));
            }),
            StopReason::LeaseLost);
}

TEST_F(LeaseTest, OutlivesAHeartbeatThatIsNotAnswered) {
  service.lease_seconds = 3;
  service.unanswered_heartbeats = 1;
  Lease lease(identity(), [](Lease&) {});
  service.wait_for_heartbeat([](const v1::HeartbeatRequest&) { return true; });
  EXPECT_EQ(lease.stop_reason(), StopReason::None);
}

TEST_F(LeaseTest, EndsWhenTheDaemonStaysAwayForItsLength) {
  service.lease_seconds = 0.1;
  EXPECT_EQ(reason_when_late([this](Lease&) { daemon.reset(); }), StopReason::Unreachable);
}

TEST_F(LeaseTest, OutlivesADaemonThatComesBack) {
  testing_support::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "socket").string();
  daemon.emplace(address, std::initializer_list<grpc::Service*>{&service});
  Lease lease({address, {}, "job-1", 3, "secret", ""}, [](Lease&) {});
  daemon.reset();
  daemon.emplace(address, std::initializer_list<grpc::Service*>{&service});
  v1::JobProgress progress;
  progress.set_iteration(18);
  lease.set_progress(progress);
  service.wait_for_heartbeat([](const v1::HeartbeatRequest& beat) { return beat.progress().iteration() == 18; });
  EXPECT_EQ(lease.stop_reason(), StopReason::None);
}

TEST_F(LeaseTest, HandsInTheOutcomeUntilItIsAccepted) {
  service.refused_completions = 2;
  Lease lease(identity(), [](Lease&) {});
  v1::Artifact artifact;
  artifact.set_name("report.json");
  lease.complete_success({artifact});
  ASSERT_EQ(service.outcomes.size(), 1u);
  EXPECT_EQ(service.outcomes[0].job_id(), "job-1");
  EXPECT_EQ(service.outcomes[0].attempt(), 3);
  EXPECT_EQ(service.outcomes[0].token(), "secret");
  EXPECT_EQ(service.outcomes[0].success().artifacts(0).name(), "report.json");

  lease.complete_failure("INPUT_UNREADABLE", "the file is empty");
  EXPECT_EQ(service.outcomes[1].failure().reason(), "INPUT_UNREADABLE");
  lease.complete_cancelled();
  EXPECT_TRUE(service.outcomes[2].has_cancelled());
}

TEST_F(LeaseTest, IsNotLostByAHeartbeatThatComesAfterTheOutcome) {
  Lease lease(identity(), [](Lease&) {});
  lease.complete_cancelled();
  service.answer_with(v1::HeartbeatResponse::COMMAND_UNSPECIFIED, grpc::Status(grpc::StatusCode::ABORTED, "done"));
  v1::JobProgress progress;
  progress.set_iteration(1);
  lease.set_progress(progress);
  service.wait_for_heartbeat([](const v1::HeartbeatRequest& beat) { return beat.progress().iteration() == 1; });
  progress.set_iteration(2);
  lease.set_progress(progress);
  // The second of two heartbeats: the answer to the first has been taken in.
  service.wait_for_heartbeat([](const v1::HeartbeatRequest& beat) { return beat.progress().iteration() == 2; });
  EXPECT_EQ(lease.stop_reason(), StopReason::None);
}

}  // namespace
}  // namespace saltus::worker
