// What the program tells systemd, or whatever speaks its protocol: a socket of the test takes its place.
#include "tests/integration/server/daemon_test.h"
#include "tests/support/child_process.h"

#include <gmock/gmock.h>

#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <fstream>

namespace saltus::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using testing_support::ChildProcess;

/// A socket that datagrams are sent to.
class NotifySocket {
 public:
  explicit NotifySocket(const std::string& path) : descriptor_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    const timeval patience{60, 0};
    setsockopt(descriptor_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  }
  ~NotifySocket() { close(descriptor_); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  /// The next message; waits for it. "": none came.
  std::string next(int flags = 0) {
    char bytes[4096];
    const ssize_t count = recv(descriptor_, bytes, sizeof bytes, flags);
    return count < 0 ? "" : std::string(bytes, static_cast<std::size_t>(count));
  }
  /// All that has come and not been read, a line each.
  std::string rest() {
    std::string all, message;
    while (!(message = next(MSG_DONTWAIT)).empty()) all += message + "\n";
    return all;
  }

 private:
  int descriptor_;
};

class Notified : public testing_support::DaemonTest {
 protected:
  ChildProcess run(std::map<std::string, std::string> environment, const std::string& worker = "/bin/true") {
    environment.emplace("NOTIFY_SOCKET", path);
    return ChildProcess({SALTUS_DAEMON, "--data", folder / "data", "--worker", worker, "--disk-reserve", "0"},
                        environment);
  }
  static void stop(ChildProcess& process) {
    process.signal(SIGTERM);
    EXPECT_EQ(process.wait(), 0) << process.err();
  }
  const std::string path = folder / "notify";
  NotifySocket manager{path};
};

TEST_F(Notified, IsReadyWhenItServesAndTellsThatItStops) {
  auto process = run({});
  EXPECT_THAT(manager.next(), HasSubstr("READY=1\nSTATUS=serves unix:"));
  connect("unix:" + (folder / "data/saltusd.sock").string());
  grpc::ClientContext context;
  v1::ServerInfo answer;
  EXPECT_TRUE(info->GetServerInfo(&context, {}, &answer).ok());
  stop(process);
  const std::string rest = manager.rest();
  EXPECT_THAT(rest, HasSubstr("STOPPING=1"));
  EXPECT_THAT(rest, Not(HasSubstr("WATCHDOG")));
}

TEST_F(Notified, BeatsForTheWatchdogAsLongAsItServes) {
  auto process = run({{"WATCHDOG_USEC", "80000"}});
  EXPECT_THAT(manager.next(), HasSubstr("READY=1"));
  for (int beat = 0; beat < 5; ++beat) EXPECT_EQ(manager.next(), "WATCHDOG=1");
  stop(process);
  EXPECT_THAT(manager.rest(), HasSubstr("STOPPING=1"));
}

TEST_F(Notified, DoesNotBeatForAnotherProcess) {
  auto process = run({{"WATCHDOG_USEC", "1000"}, {"WATCHDOG_PID", "1"}});
  EXPECT_THAT(manager.next(), HasSubstr("READY=1"));
  EXPECT_THAT(manager.next(MSG_DONTWAIT), Not(HasSubstr("WATCHDOG")));
  stop(process);
  EXPECT_THAT(manager.rest(), Not(HasSubstr("WATCHDOG")));
}

TEST_F(Notified, NoWorkerSpeaksForTheDaemon) {
  const auto worker = folder.write("worker", "#!/bin/sh\nenv > " + (folder / "environment").string() + "\n");
  std::filesystem::permissions(worker, std::filesystem::perms::owner_all);
  ASSERT_EQ(mkfifo((folder / "environment").c_str(), 0600), 0);
  auto process = run({{"WATCHDOG_USEC", "60000000"}}, worker);
  process.wait_for_output("listening on ");
  connect("unix:" + (folder / "data/saltusd.sock").string());
  created();
  const std::string environment = testing_support::content_of(folder / "environment");
  EXPECT_THAT(environment, HasSubstr("TMPDIR="));
  EXPECT_THAT(environment, Not(HasSubstr("NOTIFY_SOCKET")));
  EXPECT_THAT(environment, Not(HasSubstr("WATCHDOG")));
  stop(process);
}

TEST_F(Notified, GoesOnWithoutAManagerThatListens) {
  auto process = run({{"NOTIFY_SOCKET", folder / "absent"}});
  process.wait_for_output("does not take 'READY=1'");
  stop(process);
}

TEST_F(Notified, RefusesAnEnvironmentThatCannotBeMeant) {
  for (const char* time : {"soon", "0", "-5"}) {
    auto process = run({{"WATCHDOG_USEC", time}});
    EXPECT_EQ(process.wait(), 2);
    EXPECT_THAT(process.err(), HasSubstr("WATCHDOG_USEC is '" + std::string(time) + "'"));
  }
  auto process = run({{"NOTIFY_SOCKET", "nowhere"}});
  EXPECT_EQ(process.wait(), 2);
  EXPECT_THAT(process.err(), HasSubstr("NOTIFY_SOCKET is 'nowhere'"));
}

// The beat of the watchdog is no timer: it says that a call through gRPC has come back to the daemon's own thread.
TEST_F(Notified, ABeatIsAnAnsweredCall) {
  std::atomic<int> beats{0};
  tune = [&](DaemonSettings& settings) {
    settings.ping_interval = std::chrono::milliseconds(1);
    settings.on_alive = [&] { ++beats; };
  };
  start();
  while (beats < 5) {
  }
  daemon->stop();
  const std::string name = "\nsaltusd_callback_latency_seconds_count ", text = daemon->metrics().text();
  const auto at = text.find(name);
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(std::stoi(text.substr(at + name.size())), beats);
}

}  // namespace
}  // namespace saltus::server
