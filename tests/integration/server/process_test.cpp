// The program itself: its command line, its signals, and workers that are real processes.
#include "server/store/database.h"
#include "tests/integration/server/daemon_test.h"
#include "tests/support/certificates.h"
#include "tests/support/child_process.h"

#include <gmock/gmock.h>

#include <signal.h>
#include <sys/stat.h>

#include <fstream>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing_support::ChildProcess;
using testing_support::ProcessHandle;

class Process : public testing_support::DaemonTest {
 protected:
  /// Writes its process number to $folder/started-N, then `script`, which finds the daemon's blobs in $blobs and its
  /// uploads in $uploads.
  void use_worker(const std::string& script) {
    program = folder.write(
        "worker",
        "#!/bin/sh\nfolder=" + folder.path().string() +
            "\nwhile [ $# -gt 1 ]; do case $1 in --attempt) attempt=$2;; --blobs) blobs=$2;; --uploads) uploads=$2;; " +
            "esac; shift 2; done\n" + "echo $$ > $folder/started-$attempt\n" + script + "\n");
    fs::permissions(program, fs::perms::owner_all);
  }
  /// With the test's own data, worker and one slot unless `arguments` says otherwise.
  ChildProcess run(std::vector<std::string> arguments = {}) {
    std::vector<std::string> command = {SALTUS_DAEMON};
    const std::pair<std::string, std::string> defaults[] = {{"--data", folder / "data"},
                                                            {"--worker", program},
                                                            {"--slots", "1"},
                                                            {"--disk-reserve", "0"},
                                                            {"--retry-seconds", "0"}};
    for (const auto& [option, value] : defaults)
      if (std::find(arguments.begin(), arguments.end(), option) == arguments.end())
        command.insert(command.end(), {option, value});
    command.insert(command.end(), arguments.begin(), arguments.end());
    return ChildProcess(command);
  }
  ChildProcess serve(std::vector<std::string> arguments = {}) {
    ChildProcess process = run(std::move(arguments));
    const std::string said = "listening on ";
    const std::string line = process.wait_for_output(said);
    address = line.substr(line.find(said) + said.size());
    connect(address);
    return process;
  }
  /// So that no worker outlives the test.
  static void stop(ChildProcess& process) {
    process.signal(SIGTERM);
    EXPECT_EQ(process.wait(), 0);
  }
  /// Waits until the daemon has noted the worker's process, by which it finds it after a restart.
  void wait_for_note() {
    Database database(folder / "data/saltusd.db", Database::Access::ReadOnly);
    while (true) {
      Query query = database.query("SELECT process FROM job");
      if (query.step() && !query.text().empty()) return;
    }
  }
  /// Waits for the worker of this attempt; a pipe in the file system makes the wait end when it writes.
  pid_t worker_of(int attempt) {
    pid_t pid = 0;
    std::ifstream(folder / ("started-" + std::to_string(attempt))) >> pid;
    return pid;
  }
  void expect_worker(int attempt) {
    ASSERT_EQ(mkfifo((folder / ("started-" + std::to_string(attempt))).c_str(), 0600), 0);
  }
  /// Reads the stream until its end; the last state.
  v1::JobState watch(const std::string& id) {
    grpc::ClientContext context;
    v1::WatchRegistrationJobRequest request;
    request.set_id(id);
    const auto reader = jobs->WatchRegistrationJob(&context, request);
    v1::WatchRegistrationJobResponse event;
    v1::JobState last = v1::JOB_STATE_UNSPECIFIED;
    while (reader->Read(&event)) last = event.job().state();
    EXPECT_TRUE(reader->Finish().ok());
    return last;
  }

  fs::path program = "/bin/true";
  std::string address;  ///< of the daemon that was started last
};

TEST_F(Process, ServesOnAPortOfItsChoiceAndStopsWhenAsked) {
  auto process = serve({"--listen", "127.0.0.1:0"});
  grpc::ClientContext context;
  v1::ServerInfo answer;
  EXPECT_TRUE(info->GetServerInfo(&context, {}, &answer).ok());
  EXPECT_EQ(answer.worker_slots(), 1);
  process.signal(SIGTERM);
  EXPECT_EQ(process.wait(), 0);
}

TEST_F(Process, TheSocketIsForOwnerAndGroup) {
  auto process = serve();
  struct stat status {};
  ASSERT_EQ(stat((folder / "data/saltusd.sock").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0660u);
}

TEST_F(Process, RefusesWhatItCannotDoAndSaysWhy) {
  const auto expect_refused = [&](std::vector<std::string> arguments, int code, const std::string& said) {
    auto process = run(std::move(arguments));
    EXPECT_EQ(process.wait(), code);
    EXPECT_THAT(process.err(), HasSubstr(said));
  };
  expect_refused({"--listen", "0.0.0.0:7000"}, 2, "mutual TLS");
  expect_refused({"--listen", "[::1]:0", "--listen", "127.0.0.1:0"}, 2, "one address for this machine is enough");
  expect_refused({"--worker", "/nowhere/saltus-worker"}, 2, "--worker is /nowhere/saltus-worker");
  expect_refused({"--slots", "-1"}, 2, "--slots");
  expect_refused({"--lease-seconds", "0"}, 2, "--lease-seconds");
  auto first = serve({"--listen", "127.0.0.1:0"});
  expect_refused({}, 1, "another saltusd");
  expect_refused({"--data", folder / "other", "--listen", address}, 1, "cannot listen");
}

TEST_F(Process, RefusesMutualTlsThatWouldProtectNothing) {
  const testing_support::Authority authority;
  const auto certificate = authority.server();
  const std::string cert = folder.write("server.pem", certificate.pem());
  const std::string key = folder.write("server.key", certificate.key_pem());
  const std::string other_key = folder.write("other.key", authority.server().key_pem());
  const std::string ca = folder.write("ca.pem", authority.root.pem());
  const std::string roles = folder.write("roles", "reader = reader\n");
  const std::string bad_roles = folder.write("bad_roles", "reader = reader\nwriter = all\n");
  const auto expect_refused = [&](std::vector<std::string> arguments, const std::string& said) {
    auto process = run(std::move(arguments));
    EXPECT_EQ(process.wait(), 2);
    EXPECT_THAT(process.err(), HasSubstr(said));
    EXPECT_EQ(std::count(process.err().begin(), process.err().end(), '\n'), 1) << process.err();
  };
  const auto tls = [&](const std::string& c, const std::string& k, const std::string& a, const std::string& r) {
    return std::vector<std::string>{
        "--listen", "127.0.0.1:0", "--tls-cert", c, "--tls-key", k, "--tls-client-ca", a, "--roles", r};
  };
  expect_refused({"--listen", "127.0.0.1:0", "--tls-cert", cert, "--tls-key", key, "--roles", roles},
                 "--tls-client-ca is not given");
  expect_refused({"--listen", "127.0.0.1:0", "--tls-cert", cert, "--tls-key", key, "--tls-client-ca", ca},
                 "--roles is not given");
  expect_refused({"--tls-cert", cert, "--tls-key", key, "--tls-client-ca", ca, "--roles", roles}, "no port to protect");
  expect_refused(tls("/nowhere", key, ca, roles), "--tls-cert is /nowhere, which cannot be read");
  expect_refused(tls(roles, key, ca, roles), "which holds no certificate");
  expect_refused(tls(cert, other_key, ca, roles), "which is not the key of --tls-cert");
  expect_refused(tls(cert, key, roles, roles), "--tls-client-ca is");
  expect_refused(tls(cert, key, ca, bad_roles), "line 2: 'all' is no role");
  expect_refused(tls(cert, key, ca, "/nowhere"), "--roles is /nowhere, which cannot be read");
}

TEST_F(Process, ServesLocalCallersBesideMutualTls) {
  const testing_support::Authority authority;
  const auto certificate = authority.server();
  auto process = serve({"--listen", "127.0.0.1:0", "--tls-cert", folder.write("server.pem", certificate.pem()),
                        "--tls-key", folder.write("server.key", certificate.key_pem()), "--tls-client-ca",
                        folder.write("ca.pem", authority.root.pem()), "--roles", folder.write("roles", "")});
  EXPECT_THAT(address, ::testing::MatchesRegex("unix:.*/data/saltusd[.]sock"));
  process.wait_for_output("with mutual TLS");
  grpc::ClientContext context;
  v1::ServerInfo answer;
  EXPECT_TRUE(info->GetServerInfo(&context, {}, &answer).ok());
}

TEST_F(Process, DoesNotTakeASocketFromAnotherDaemon) {
  auto first = serve();
  auto second = run({"--data", folder / "other", "--listen", "unix:" + (folder / "data/saltusd.sock").string()});
  EXPECT_EQ(second.wait(), 1);
  EXPECT_THAT(second.err(), HasSubstr("another program listens"));
}

// Nothing reads the pipe with the log before the end; it holds 64 KiB.
TEST_F(Process, GoesOnWhenNobodyReadsItsLog) {
  use_worker("exec sleep 1000");
  auto process = serve();
  const auto request = valid_request();
  for (int i = 0; i < 500; ++i) {
    v1::RegistrationJob job;
    ASSERT_TRUE(create(request, job).ok());
    cancel(job.id());
  }
  stop(process);
  EXPECT_GT(process.err().size(), 64u << 10);
  EXPECT_THAT(process.err(), ::testing::EndsWith("stopped\n"));
}

// The child's standard input is empty from the start.
TEST_F(Process, APrivateDaemonGoesWithItsClient) {
  auto process = serve({"--exit-on-stdin-close"});
  EXPECT_EQ(process.wait(), 0);
}

// Whoever waits for the daemon sees that it takes no jobs, until it is gone.
TEST_F(Process, TellsThatItDrainsWhenItIsAskedToStop) {
  use_worker("trap '' TERM; while :; do sleep 1000; done");
  expect_worker(1);
  auto process = serve();
  created();
  const ProcessHandle worker_process(worker_of(1));
  v1::ServerInfo answer;
  const auto ask = [&] {
    grpc::ClientContext context;
    return info->GetServerInfo(&context, {}, &answer).ok();
  };
  ASSERT_TRUE(ask());
  EXPECT_FALSE(answer.is_draining());
  process.signal(SIGTERM);
  // The worker that does not listen keeps the daemon until it is killed.
  while (ask() && !answer.is_draining()) {
  }
  EXPECT_TRUE(answer.is_draining());
  EXPECT_EQ(process.wait(), 0);
}

TEST_F(Process, AWorkerSeesItsInputsAsFilesAndMayLeaveResultsAsFiles) {
  ASSERT_EQ(mkfifo((folder / "found").c_str(), 0600), 0);
  use_worker("cd $uploads && pwd > $folder/uploads; cat $blobs/*/* > $folder/found; exec sleep 1000");
  auto process = serve();
  const auto job = created();
  EXPECT_THAT(testing_support::content_of(folder / "found"), ::testing::AnyOf("fixedmoving", "movingfixed"));
  EXPECT_EQ(testing_support::content_of(folder / "uploads"), fs::canonical(folder / "data/uploads").string() + "\n");
  cancel(job.id());
  stop(process);
}

TEST_F(Process, ACancelEndsAWorkerThatListensToNothing) {
  use_worker("trap '' TERM; while :; do sleep 1000; done");
  expect_worker(1);
  auto process = serve();
  const auto job = created();
  const ProcessHandle worker_process(worker_of(1));
  cancel(job.id());
  EXPECT_EQ(watch(job.id()), v1::JOB_STATE_CANCELLED);
  EXPECT_TRUE(worker_process.ends_within(std::chrono::milliseconds(0)));
  EXPECT_TRUE(fs::is_empty(folder / "data/run"));
}

TEST_F(Process, ACrashingWorkerIsTriedTwiceAndThenGivenUp) {
  use_worker("kill -SEGV $$");
  auto process = serve();
  const auto job = created();
  EXPECT_EQ(watch(job.id()), v1::JOB_STATE_FAILED);
  EXPECT_EQ(get(job.id()).failure().reason(), "WORKER_CRASHED");
  EXPECT_EQ(get(job.id()).attempt(), 2);
}

TEST_F(Process, AKilledDaemonFindsItsWorkerAgain) {
  use_worker("exec sleep 1000");
  expect_worker(1);
  auto first = serve();
  const auto job = created();
  const ProcessHandle worker_process(worker_of(1));
  wait_for_note();
  first.signal(SIGKILL);
  first.wait();
  EXPECT_FALSE(worker_process.ends_within(std::chrono::milliseconds(0)));

  auto second = serve();
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_RUNNING);
  EXPECT_EQ(get(job.id()).attempt(), 1);
  cancel(job.id());
  EXPECT_EQ(watch(job.id()), v1::JOB_STATE_CANCELLED);
  EXPECT_TRUE(worker_process.ends_within(std::chrono::milliseconds(0)));
}

TEST_F(Process, WhenDaemonAndWorkerAreKilledTheJobIsTriedAgain) {
  use_worker("exec sleep 1000");
  expect_worker(1);
  expect_worker(2);
  auto first = serve();
  const auto job = created();
  const pid_t pid = worker_of(1);
  const ProcessHandle worker_process(pid);
  wait_for_note();
  first.signal(SIGKILL);
  first.wait();
  ::kill(pid, SIGKILL);
  ASSERT_TRUE(worker_process.ends_within(std::chrono::seconds(60)));

  auto second = serve();
  EXPECT_GT(worker_of(2), 0);
  EXPECT_EQ(get(job.id()).attempt(), 2);
  stop(second);
}

TEST_F(Process, AnOrderlyStopEndsWorkersAndTheJobGoesOnLater) {
  use_worker("exec sleep 1000");
  expect_worker(1);
  expect_worker(2);
  auto first = serve();
  const auto job = created();
  const ProcessHandle worker_process(worker_of(1));
  first.signal(SIGTERM);
  EXPECT_EQ(first.wait(), 0);
  EXPECT_TRUE(worker_process.ends_within(std::chrono::milliseconds(0)));
  auto second = serve();
  EXPECT_GT(worker_of(2), 0);
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_RUNNING);
  stop(second);
}

}  // namespace
}  // namespace saltus::server
