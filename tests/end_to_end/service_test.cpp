#include "tests/end_to_end/end_to_end.h"
#include "tests/support/certificates.h"
#include "tests/support/scrape.h"

#include <csignal>
#include <fstream>
#include <limits>
#include <sstream>
#include <thread>

namespace saltus {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing_support::blob_scene;
using testing_support::ChildProcess;
using testing_support::content_of;
using testing_support::EndToEnd;
using testing_support::Outcome;
using testing_support::ProcessHandle;
using testing_support::programs;
using testing_support::ServerTest;

TEST_F(EndToEnd, RegistersWithoutAServerAndLeavesNothingBehind) {
  const std::filesystem::path out = folder / "out";
  const Outcome outcome = run(job({"register", "--out", out}, of_a_moment()));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("gaussian, ssd, fast"), HasSubstr("similarity"), HasSubstr(out.string())));
  EXPECT_THAT(outcome.err, HasSubstr("succeeded"));
  expect_shift(out / "displacement.mha");
  for (const char* name : {"inverse_displacement.mha", "warped.mha", "jacobian.mha", "momentum_1_order0.mha",
                           "transform.h5", "interface.csv", "interface.vtp", "report.json", "report.html"})
    EXPECT_TRUE(std::filesystem::exists(out / name)) << name;
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
}

TEST_F(EndToEnd, RegisterTellsJobAndReportAsJson) {
  const Outcome outcome = run(job({"register", "--json", "--out", folder / "out"}, of_a_moment()));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json answer = json::parse(outcome.out);
  EXPECT_EQ(answer["job"]["state"], "SUCCEEDED");
  EXPECT_EQ(answer["report"], json::parse(content_of(folder / "out" / "report.json")));
}

TEST_F(EndToEnd, AnInterruptCancelsTheJobAndLeavesNothingBehind) {
  ChildProcess child = start(job({"register", "--out", folder / "out"}, of_minutes()));
  child.wait_for_output("iteration");
  child.signal(SIGINT);
  EXPECT_EQ(child.wait(), 4);
  EXPECT_THAT(child.err(), HasSubstr("was cancelled"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
  EXPECT_FALSE(std::filesystem::exists(folder / "out"));
}

// The daemon's folder is there before the daemon has answered anything.
TEST_F(EndToEnd, AnInterruptAtAnyTimeLeavesNothingBehind) {
  for (int attempt = 0; attempt < 5; ++attempt) {
    ChildProcess child = start(job({"register", "--out", folder / "out"}, of_minutes()));
    while (std::filesystem::is_empty(folder / "tmp"))
      ASSERT_FALSE(ProcessHandle(child.id()).ends_within(std::chrono::milliseconds(attempt))) << child.err();
    child.signal(SIGINT);
    EXPECT_EQ(child.wait(), 4) << child.err();
    EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
  }
}

struct BadInput {
  const char* name;
  int exit_code;
  std::vector<std::string> more;       ///< options that go behind good ones
  std::vector<std::string> complaint;  ///< what the message must name
};

class BadInputTest : public EndToEnd, public testing::WithParamInterface<BadInput> {};

TEST_P(BadInputTest, EndsWithItsCodeAndOneLine) {
  folder.write("text.mha", "no image");
  write_volume(folder / "mask.mha", blob_scene(20, 0));
  std::vector<std::string> more = GetParam().more;
  for (std::string& word : more)
    if (word.ends_with(".mha")) word = (folder / word).string();
  const Outcome outcome = run(job({"register", "--out", folder / "out"}, more));
  EXPECT_EQ(outcome.exit_code, GetParam().exit_code) << outcome.err;
  const auto begin = outcome.err.find("saltus: ");
  ASSERT_NE(begin, std::string::npos) << outcome.err;
  const std::string complaint = outcome.err.substr(begin);
  EXPECT_EQ(std::count(complaint.begin(), complaint.end(), '\n'), 1) << complaint;
  for (const std::string& text : GetParam().complaint) EXPECT_THAT(complaint, HasSubstr(text));
}

INSTANTIATE_TEST_SUITE_P(
    EndToEnd, BadInputTest,
    testing::Values(BadInput{"unreadable", 1, {"--fixed-mask", "text.mha"}, {"INPUT_UNREADABLE", "fixed_mask.mha"}},
                    BadInput{"mask_elsewhere", 1, {"--moving-mask", "mask.mha"}, {"GEOMETRY_MISMATCH", "moving mask"}},
                    BadInput{"window", 2, {"--intensity-window", "5,1"}, {"--intensity-window", "5,1"}},
                    BadInput{"outside_crop", 1, {"--crop", "0,0:500,20"}, {"INVALID_OPTIONS"}},
                    BadInput{"parameter", 2, {"--set", "steps=4"}, {"steps"}}),
    [](const auto& info) { return info.param.name; });

TEST_F(EndToEnd, NamesAResultFolderThatCannotBeMadeBeforeItWorks) {
  folder.write("taken", "a file");
  for (const std::string& out : {(folder / "taken").string(), std::string("/proc/nowhere")}) {
    const Outcome outcome = run(job({"register", "--out", out}, {}));
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("--out is '" + out));
    EXPECT_THAT(outcome.err, testing::Not(HasSubstr("optimising")));
  }
}

TEST_F(ServerTest, KeepsAJobFromSubmissionToDeletion) {
  const std::string id = submit();
  EXPECT_EQ(run(here({"watch", id})).exit_code, 0);
  EXPECT_EQ(get(id)["state"], "SUCCEEDED");

  const json listed = json::parse(run(here({"list", "--json", "--state", "succeeded"})).out);
  ASSERT_EQ(listed.size(), 1u);
  EXPECT_EQ(listed[0]["id"], id);

  const Outcome fetched = run(here({"fetch", id, "--out", folder / "out"}));
  EXPECT_EQ(fetched.exit_code, 0) << fetched.err;
  expect_shift(folder / "out" / "displacement.mha");

  EXPECT_EQ(run(here({"delete", id})).exit_code, 0);
  const Outcome gone = run(here({"get", id}));
  EXPECT_EQ(gone.exit_code, 1);
  EXPECT_THAT(gone.err, HasSubstr(id));
}

TEST_F(ServerTest, WatchTellsEachStateAsALineOfJson) {
  const Outcome outcome = run(here({"watch", submit(), "--json"}));
  EXPECT_EQ(outcome.exit_code, 0);
  std::istringstream lines(outcome.out);
  json last;
  for (std::string line; std::getline(lines, line);) last = json::parse(line);
  EXPECT_EQ(last["state"], "SUCCEEDED");
}

TEST_F(ServerTest, ACancelledJobStopsItsWorkerSoon) {
  const std::string id = submit(of_minutes());
  ChildProcess watch = start(here({"watch", id}));
  watch.wait_for_output("iteration");
  const auto workers = daemon->children();
  ASSERT_EQ(workers.size(), 1u);
  const ProcessHandle worker(workers[0]);

  EXPECT_EQ(run(here({"cancel", id})).exit_code, 0);
  EXPECT_TRUE(worker.ends_within(std::chrono::seconds(10)));
  EXPECT_EQ(watch.wait(), 4);
  EXPECT_THAT(watch.err(), HasSubstr("was cancelled"));
  EXPECT_EQ(get(id)["state"], "CANCELLED");
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp")) << "the worker left files";
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data" / "work")) << "the worker left files";
  EXPECT_EQ(run(here({"fetch", id, "--out", folder / "out"})).exit_code, 4);
}

TEST_F(ServerTest, AJobOutlivesAKilledDaemon) {
  const std::string id = submit(of_some_seconds());
  ChildProcess watch = start(here({"watch", id}));
  watch.wait_for_output("iteration");
  const auto workers = daemon->children();
  ASSERT_EQ(workers.size(), 1u);
  const ProcessHandle worker(workers[0]);
  daemon->signal(SIGKILL);
  EXPECT_EQ(daemon->wait(), 128 + SIGKILL);
  ASSERT_FALSE(worker.ends_within(std::chrono::seconds(0))) << "the job was over too early to show anything";

  start_daemon();
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  const json job = get(id);
  EXPECT_EQ(job["state"], "SUCCEEDED");
  EXPECT_EQ(job["attempt"], 1) << "the worker's own attempt counts";
  EXPECT_EQ(run(here({"fetch", id, "--out", folder / "out"})).exit_code, 0);
  expect_shift(folder / "out" / "displacement.mha");
}

/// A daemon that counts what comes and goes.
class CountingServerTest : public ServerTest {
 protected:
  CountingServerTest() { daemon_options = {"--metrics", "127.0.0.1:0"}; }
  /// What the metric of this name says.
  std::uintmax_t count_of(const std::string& name) {
    const std::string said = "metrics on http://127.0.0.1:";
    const std::string line = daemon->wait_for_output(said);
    const std::string page = testing_support::scraped(std::stoi(line.substr(line.find(said) + said.size())));
    const auto at = page.find("\n" + name + " ");
    if (at == std::string::npos) throw std::runtime_error(name + " is not among the metrics");
    return static_cast<std::uintmax_t>(std::stod(page.substr(at + name.size() + 2)));
  }
};

// A worker on the daemon's machine reads its images and gives its results as files.
TEST_F(CountingServerTest, NothingGoesThroughTheDaemonToAWorkerOnItsMachineOrBack) {
  const std::string id = submit();
  EXPECT_EQ(run(here({"watch", id})).exit_code, 0);
  const std::uintmax_t images =
      std::filesystem::file_size(folder / "fixed.mha") + std::filesystem::file_size(folder / "moving.mha");
  EXPECT_EQ(count_of("saltusd_upload_bytes_total"), images);
  EXPECT_EQ(count_of("saltusd_download_bytes_total"), 0u);
  EXPECT_EQ(run(here({"fetch", id, "--out", folder / "out"})).exit_code, 0);
  EXPECT_GT(count_of("saltusd_download_bytes_total"), images);
  expect_shift(folder / "out" / "displacement.mha");
}

/// A daemon whose workers make checkpoints as often as they can.
class CheckpointTest : public ServerTest {
 protected:
  CheckpointTest() { daemon_options = {"--checkpoint-seconds", "0.001", "--retry-seconds", "0"}; }

  pid_t only_worker() const {
    const auto workers = daemon->children();
    EXPECT_EQ(workers.size(), 1u);
    return workers.at(0);
  }
  /// Asks until a second attempt says that it goes on from the checkpoint of the first.
  void wait_until_resumed(const std::string& id) const {
    while (true) {
      const json job = get(id);
      if (job.contains("progress") && job["progress"].contains("is_resumed")) return;
      ASSERT_TRUE(job["state"] == "RUNNING" || job["state"] == "QUEUED") << job;
    }
  }
};

TEST_F(CheckpointTest, WhatIsKilledGoesOnFromItsCheckpointToTheSameBits) {
  const std::string undisturbed = submit(of_some_seconds());
  EXPECT_EQ(run(here({"watch", undisturbed})).exit_code, 0);
  const auto expected = results(undisturbed);

  const std::string id = submit(of_some_seconds());
  ChildProcess watch = start(here({"watch", id, "--json"}));
  watch.wait_for_output("\"checkpoints\"");
  kill(only_worker(), SIGKILL);
  wait_until_resumed(id);
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  EXPECT_EQ(get(id)["attempt"], 2);
  EXPECT_EQ(results(id), expected);

  const std::string other = submit(of_some_seconds());
  ChildProcess watch_other = start(here({"watch", other, "--json"}));
  watch_other.wait_for_output("\"checkpoints\"");
  const pid_t worker = only_worker();
  const ProcessHandle handle(worker);
  daemon->signal(SIGKILL);
  EXPECT_EQ(daemon->wait(), 128 + SIGKILL);
  kill(worker, SIGKILL);
  ASSERT_TRUE(handle.ends_within(std::chrono::seconds(60)));
  start_daemon();
  wait_until_resumed(other);
  EXPECT_EQ(watch_other.wait(), 0) << watch_other.err();
  EXPECT_EQ(get(other)["attempt"], 2);
  EXPECT_EQ(results(other), expected);
}

class ShortLeaseTest : public CheckpointTest {
 protected:
  ShortLeaseTest() {
    daemon_options = {"--checkpoint-seconds", "0.001", "--lease-seconds", "1", "--retry-seconds", "0"};
  }
};

TEST_F(ShortLeaseTest, AWorkerThatStandsStillIsEndedAndAnotherGoesOn) {
  const std::string id = submit(of_some_seconds());
  ChildProcess watch = start(here({"watch", id, "--json"}));
  watch.wait_for_output("\"checkpoints\"");
  const pid_t worker = only_worker();
  const ProcessHandle handle(worker);
  kill(worker, SIGSTOP);
  EXPECT_TRUE(handle.ends_within(std::chrono::seconds(60)));
  wait_until_resumed(id);
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  EXPECT_EQ(get(id)["attempt"], 2);
}

TEST_F(ServerTest, SaysThatTheServerIsAway) {
  daemon->signal(SIGTERM);
  EXPECT_EQ(daemon->wait(), 0);
  const Outcome outcome = run(here({"list"}));
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.err, HasSubstr(address));
}

TEST_F(ServerTest, RegistersOnAGivenServer) {
  const Outcome outcome = run(here(job({"register", "--out", folder / "out"}, of_a_moment())));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  expect_shift(folder / "out" / "displacement.mha");
  EXPECT_EQ(json::parse(run(here({"list", "--json"})).out).size(), 1u) << "the job stays on the server";
}

/// A daemon that listens with mutual TLS too, and who comes from elsewhere.
class ProtectedServerTest : public EndToEnd {
 protected:
  void SetUp() override {
    EndToEnd::SetUp();
    const auto certificate = authority.server();
    folder.write("roles", "a@hospital.example = submitter\nb@hospital.example = submitter\n");
    daemon.emplace(std::vector<std::string>{programs + "/saltusd", "--data", folder / "data", "--listen", "127.0.0.1:0",
                                            "--tls-cert", folder.write("server.pem", certificate.pem()), "--tls-key",
                                            folder.write("server.key", certificate.key_pem()), "--tls-client-ca",
                                            folder.write("ca.pem", authority.root.pem()), "--roles", folder / "roles"},
                   environment());
    const std::string said = "listening on 127", line = daemon->wait_for_output("with mutual TLS");
    address = line.substr(line.find(said) + said.size() - 3);
    address = address.substr(0, address.find(' '));
  }
  /// `arguments` as somebody with a certificate gives them.
  std::vector<std::string> as(const std::string& name, std::vector<std::string> arguments) const {
    const auto certificate = authority.issue(name, "email:" + name + "@hospital.example");
    arguments.insert(arguments.end(), {"--server", address, "--tls-ca", folder / "ca.pem", "--tls-cert",
                                       folder.write(name + ".pem", certificate.pem()), "--tls-key",
                                       folder.write(name + ".key", certificate.key_pem())});
    return arguments;
  }

  testing_support::Authority authority;
  std::string address;
  std::optional<ChildProcess> daemon;
};

TEST_F(ProtectedServerTest, RegistersFromElsewhere) {
  const Outcome outcome = run(as("a", job({"register", "--out", folder / "out"}, of_a_moment())));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  expect_shift(folder / "out" / "displacement.mha");
}

TEST_F(ProtectedServerTest, RefusesWhoHasNoRole) {
  const Outcome outcome = run(as("mallory", {"list"}));
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("mallory@hospital.example"));
}

TEST_F(ServerTest, ADrainCanWaitForWhatRuns) {
  const std::string running = submit(of_minutes());
  {
    ChildProcess watching = start(here({"watch", running}));
    watching.wait_for_output("iteration");
  }
  ChildProcess draining = start(here({"server", "drain", "--wait"}));
  draining.wait_for_output("1 job still runs");
  EXPECT_NE(run(here(job({"submit"}))).exit_code, 0) << "no new jobs meanwhile";
  EXPECT_EQ(run(here({"cancel", running})).exit_code, 0);
  EXPECT_EQ(draining.wait(), 0);
  EXPECT_THAT(draining.out(), AllOf(HasSubstr("is_draining: yes"), HasSubstr("running_jobs: 0")));
  EXPECT_EQ(run(here({"server", "drain", "--resume"})).exit_code, 0);
  submit();
}

TEST_F(ServerTest, AWaitForADrainNoticesThatSomebodyResumes) {
  const std::string running = submit(of_minutes());
  {
    ChildProcess watching = start(here({"watch", running}));
    watching.wait_for_output("iteration");
  }
  ChildProcess draining = start(here({"server", "drain", "--wait"}));
  draining.wait_for_output("1 job still runs");
  EXPECT_EQ(run(here({"server", "drain", "--resume"})).exit_code, 0);
  EXPECT_EQ(draining.wait(), 1);
  EXPECT_THAT(draining.err(), HasSubstr("takes jobs again"));
  EXPECT_EQ(run(here({"cancel", running})).exit_code, 0);
}

/// Writes into the header of a NIfTI-1 file where scanners leave names: descrip (80 bytes from byte 148) and aux_file
/// (24 from byte 228).
void write_names(const std::filesystem::path& file, const std::string& descrip, const std::string& aux_file) {
  std::fstream header(file, std::ios::binary | std::ios::in | std::ios::out);
  header.seekp(148);
  header << descrip;
  header.seekp(228);
  header << aux_file;
  ASSERT_TRUE(header.good());
}

// What a hospital would find in a log file: names in paths, in labels, in the headers of images; and what would open
// the door to a job's data.
TEST_F(EndToEnd, NoLogSaysWhoseImagesTheseAre) {
  const std::filesystem::path images = folder / "Doe^John";
  std::filesystem::create_directory(images);
  write_volume(images / "fixed_Doe.nii", blob_scene(48, 0));
  write_volume(images / "moving_Doe.nii", blob_scene(48, testing_support::shift_mm));
  // Fails in the worker, which then has something to say about it. (Readers of NIfTI make a zero of it.)
  auto broken_scene = blob_scene(48, 0);
  broken_scene.samples[17] = std::numeric_limits<float>::quiet_NaN();
  write_volume(images / "broken_Doe.mha", broken_scene);
  for (const char* name : {"fixed_Doe.nii", "moving_Doe.nii"})
    write_names(images / name, "DOE^JOHN 1970-01-01 PAT4711", "Doe_John.par");

  // A worker that leaves its token where the test finds it.
  folder.write("worker", "#!/bin/sh\nfor word in \"$@\"; do\n  [ \"$before\" = --token-file ] && cat \"$word\" >> '" +
                             (folder / "tokens").string() + "'\n  before=$word\ndone\nexec '" + programs +
                             "/saltus-worker' \"$@\"\n");
  std::filesystem::permissions(folder / "worker", std::filesystem::perms::owner_all);
  const std::filesystem::path data = folder / "data";
  ChildProcess daemon({programs + "/saltusd", "--data", data, "--worker", folder / "worker", "--log-format", "json",
                       "--log-level", "trace"},
                      environment());
  const std::string said = "listening on ", line = daemon.wait_for_output(said);
  const std::string address = line.substr(line.find(said) + said.size());
  const auto submit = [&](const std::string& fixed) {
    const Outcome outcome = run({"submit",
                                 "--fixed",
                                 images / fixed,
                                 "--moving",
                                 images / "moving_Doe.nii",
                                 "--format",
                                 "mha",
                                 "--preset",
                                 "fast",
                                 "--threads",
                                 "1",
                                 "--model",
                                 "gaussian",
                                 "--similarity",
                                 "ssd",
                                 "--set",
                                 "regularisation=0.0001",
                                 "--label",
                                 "patient=Doe, John",
                                 "--server",
                                 address});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.out.substr(0, outcome.out.find('\n'));
  };
  const std::string good = submit("fixed_Doe.nii"), broken = submit("broken_Doe.mha");
  EXPECT_EQ(run({"watch", good, "--server", address}).exit_code, 0);
  EXPECT_EQ(run({"watch", broken, "--server", address}).exit_code, 1);
  // A refused call: its message names the label, and goes to the caller alone.
  const Outcome refused = run({"submit", "--fixed", images / "fixed_Doe.nii", "--moving", images / "moving_Doe.nii",
                               "--label", "patient=" + std::string(400, 'D') + "oe", "--server", address});
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_EQ(run({"delete", good, "--server", address}).exit_code, 0);
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0);

  const std::string audit = content_of(data / "audit.log");
  std::string logs = daemon.out() + daemon.err() + audit;
  for (const auto& file : std::filesystem::directory_iterator(data / "logs"))
    logs += file.path().filename().string() + content_of(file.path());
  for (const std::string& job : {good, broken}) {
    EXPECT_THAT(daemon.err(), HasSubstr(job)) << "the log says something at all";
    EXPECT_THAT(audit, HasSubstr(job));
  }
  for (const char* word : {"Doe", "DOE", "PAT4711", "1970-01-01", "DDDD", "patient", ".nii", ".mha"})
    EXPECT_THAT(logs, testing::Not(HasSubstr(word)));
  std::istringstream tokens(content_of(folder / "tokens"));
  std::string token;
  int count = 0;
  for (; tokens >> token; ++count) {
    EXPECT_GE(token.size(), 32u);
    EXPECT_THAT(logs, testing::Not(HasSubstr(token)));
    EXPECT_THAT(logs, testing::Not(HasSubstr(token.substr(0, token.size() / 2))));
  }
  EXPECT_GE(count, 1);
  std::istringstream lines(daemon.err() + audit);
  for (std::string text; std::getline(lines, text);) EXPECT_TRUE(json::accept(text)) << text;
}

}  // namespace
}  // namespace saltus
