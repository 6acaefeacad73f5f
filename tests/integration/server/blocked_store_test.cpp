#include "tests/integration/server/daemon_test.h"

#include <grpcpp/generic/generic_stub.h>

#include <condition_variable>
#include <future>
#include <mutex>
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

/// Closed and opened by the test, which can wait until so many stand before it.
class Gate {
 public:
  void close() {
    std::lock_guard lock(mutex_);
    is_open_ = false;
  }
  void open() {
    {
      std::lock_guard lock(mutex_);
      is_open_ = true;
    }
    changed_.notify_all();
  }
  void pass() {
    std::unique_lock lock(mutex_);
    ++waiting_;
    changed_.notify_all();
    changed_.wait(lock, [this] { return is_open_; });
    --waiting_;
  }
  void wait_for(int count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return waiting_ >= count; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_open_ = true;
  int waiting_ = 0;
};

/// Holds up every read, and every commit after it has become durable.
class StoreBehindGate final : public JobStore {
 public:
  StoreBehindGate(std::unique_ptr<JobStore> inner, Gate& gate) : inner_(std::move(inner)), gate_(gate) {}
  void write(Operation operation, Done done) override {
    inner_->write(std::move(operation), [this, done = std::move(done)](std::exception_ptr error) {
      gate_.pass();
      done(error);
    });
  }
  void read(const std::function<void(JobReader&)>& operation) override {
    gate_.pass();
    inner_->read(operation);
  }

 private:
  std::unique_ptr<JobStore> inner_;
  Gate& gate_;
};

TEST_F(BlockedStore, APingIsAnsweredWhileUploadsCommitsAndWatchersWait) {
  Gate gate;
  DaemonParts parts;
  parts.launcher = make_launcher();
  parts.wrap_store = [&gate](std::unique_ptr<JobStore> inner) {
    return std::make_unique<StoreBehindGate>(std::move(inner), gate);
  };
  job_settings.slots = 1;
  start(std::move(parts));
  created();
  const std::string id = created().id();
  launcher->wait_for_start(1);

  gate.close();
  std::vector<std::thread> blocked;
  blocked.emplace_back([&] { cancel(id); });
  gate.wait_for(1);  // the writing thread
  for (int i = 0; i < 16; ++i)
    blocked.emplace_back([this, i] {
      const std::string content = "image " + std::to_string(i);
      EXPECT_TRUE(upload(content, digest_of(content)).ok());
    });
  for (int i = 0; i < 30; ++i)
    blocked.emplace_back([this, id] {
      grpc::ClientContext context;
      v1::WatchRegistrationJobRequest request;
      request.set_id(id);
      const auto reader = jobs->WatchRegistrationJob(&context, request);
      v1::WatchRegistrationJobResponse event;
      while (reader->Read(&event)) {
      }
      EXPECT_TRUE(reader->Finish().ok());
    });
  gate.wait_for(1 + 8);  // and every thread that may wait for the disk

  grpc::GenericStub stub(channel);
  for (int i = 0; i < 50; ++i) {
    grpc::ClientContext info_context;
    v1::ServerInfo answer;
    EXPECT_TRUE(info->GetServerInfo(&info_context, {}, &answer).ok());

    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    grpc::Slice empty;
    const auto call =
        stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", grpc::ByteBuffer(&empty, 1), &queue);
    call->StartCall();
    grpc::ByteBuffer health;
    grpc::Status status;
    call->Finish(&health, &status, nullptr);
    void* tag = nullptr;
    bool is_ok = false;
    ASSERT_TRUE(queue.Next(&tag, &is_ok));
    EXPECT_TRUE(status.ok()) << status.error_message();
  }
  gate.open();
  for (auto& thread : blocked) thread.join();
}

}  // namespace
}  // namespace saltus::server
