// A daemon that is told to stop while streams of every kind are open, again and again.
#include "tests/integration/server/daemon_test.h"

#include "saltus/v1/admin.grpc.pb.h"

#include <condition_variable>
#include <mutex>
#include <thread>

namespace saltus::server {
namespace {

constexpr int kRounds = 20;
constexpr int kUploaders = 3, kDownloaders = 3, kWatchers = 8;

class BusyStop : public testing_support::DaemonTest {
 protected:
  /// Counts what streams have done, so that a stop can come in the middle of it.
  class Events {
   public:
    void add() {
      const std::lock_guard lock(mutex_);
      ++count_;
      changed_.notify_all();
    }
    void wait_for(int count) {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return count_ >= count; });
    }

   private:
    std::mutex mutex_;
    std::condition_variable changed_;
    int count_ = 0;
  };

  /// One call after another until one does not succeed, which then has to be for the stop's sake.
  static void repeat(Events& events, const std::function<grpc::Status()>& call) {
    while (true) {
      const grpc::Status status = call();
      if (status.ok()) {
        events.add();
        continue;
      }
      const auto code = status.error_code();
      EXPECT_TRUE(code == grpc::StatusCode::UNAVAILABLE || code == grpc::StatusCode::CANCELLED)
          << code << " " << status.error_message();
      return;
    }
  }
  template <class Reader, class Response>
  static grpc::Status read_all(Reader& reader, Response& response, Events& events) {
    while (reader.Read(&response)) events.add();
    return reader.Finish();
  }

  grpc::Status upload_another(int round, int uploader) {
    const std::string content = std::to_string(round) + " " + std::to_string(uploader) + " " + std::to_string(++made) +
                                std::string(100000, 'x');
    const grpc::Status status = upload(content, digest_of(content), 10000);
    if (status.ok()) {
      const std::lock_guard lock(mutex);
      acknowledged.push_back(digest_of(content));
    }
    return status;
  }
  grpc::Status download(const std::string& digest, Events& events) {
    grpc::ClientContext context;
    v1::ReadBlobRequest request;
    request.set_digest(digest);
    v1::ReadBlobResponse response;
    return read_all(*blobs->ReadBlob(&context, request), response, events);
  }
  grpc::Status watch(const std::string& job, Events& events) {
    grpc::ClientContext context;
    v1::WatchRegistrationJobRequest request;
    request.set_id(job);
    v1::WatchRegistrationJobResponse response;
    return read_all(*jobs->WatchRegistrationJob(&context, request), response, events);
  }
  grpc::Status check(Events& events, v1::FsckResponse& last) {
    grpc::ClientContext context;
    return read_all(*v1::AdminService::NewStub(channel)->Fsck(&context, {}), last, events);
  }
  /// The worker is ended by the daemon, which waits for it.
  void stop(const LaunchRequest& running) {
    std::jthread stopping([this] { daemon->stop(); });
    while (launcher->terminated().empty() && launcher->killed().empty()) std::this_thread::yield();
    launcher->end(running.key, {WorkerExit::Kind::Signalled, SIGTERM});
  }

  std::atomic<int> made = 0;
  std::mutex mutex;
  std::vector<std::string> acknowledged;
};

TEST_F(BusyStop, EndsEveryStreamAndLosesNothing) {
  std::string large, job;
  for (int round = 0; round < kRounds; ++round) {
    SCOPED_TRACE(round);
    start();
    if (round == 0) {
      large = uploaded(std::string(4 << 20, 'y'));
      job = created().id();
    }
    const LaunchRequest running = launcher->wait_for_start(1);
    Events events;
    std::vector<std::jthread> clients;
    for (int i = 0; i < kUploaders; ++i)
      clients.emplace_back([&, i] { repeat(events, [&] { return upload_another(round, i); }); });
    for (int i = 0; i < kDownloaders; ++i)
      clients.emplace_back([&] { repeat(events, [&] { return download(large, events); }); });
    for (int i = 0; i < kWatchers; ++i)
      clients.emplace_back([&] { repeat(events, [&] { return watch(job, events); }); });
    clients.emplace_back([&] {
      v1::FsckResponse last;
      repeat(events, [&] { return check(events, last); });
    });
    events.wait_for(20 + 7 * round);
    stop(running);
    clients.clear();
    crash();
  }
  start();
  grpc::ClientContext context;
  v1::FindMissingBlobsRequest request;
  for (const std::string& digest : acknowledged)
    if (request.digests_size() < 1000) request.add_digests(digest);
  v1::FindMissingBlobsResponse response;
  EXPECT_TRUE(blobs->FindMissingBlobs(&context, request, &response).ok());
  EXPECT_EQ(response.missing_size(), 0);
  EXPECT_EQ(get(job).id(), job);
  Events events;
  v1::FsckResponse last;
  EXPECT_TRUE(check(events, last).ok());
  EXPECT_EQ(last.corrupt() + last.missing(), 0);
}

}  // namespace
}  // namespace saltus::server
