#include "server/observe/audit_log.h"

#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <thread>

namespace saltus::server {
namespace {

using testing_support::content_of;
using testing_support::TemporaryFolder;

class StandingClock final : public Clock {
 public:
  WallTime wall() const override { return WallTime(std::chrono::milliseconds(1700000000123)); }
  SteadyTime steady() const override { return {}; }
};

class AuditLogTest : public ::testing::Test {
 protected:
  static CallRecord call(const std::string& job) {
    CallRecord call;
    call.method = "/s/M";
    call.identity = "dr \"a\"";
    call.is_local = false;
    call.is_change = true;
    call.code = "OK";
    call.jobs = {job};
    return call;
  }
  auto noted() {
    return [this](const std::string& line) { logged.push_back(line); };
  }
  TemporaryFolder folder;
  StandingClock clock;
  std::vector<std::string> logged;
};

TEST_F(AuditLogTest, AppendsOneObjectALine) {
  for (const char* job : {"1", "2"}) {
    AuditLog log(folder / "audit.log", clock, noted());
    log.add(call(job));
    log.flush();
  }
  const std::string begin =
      R"({"time":"2023-11-14T22:13:20.123Z","identity":"dr \"a\"","peer":"tls","method":"/s/M","code":"OK","job":")";
  EXPECT_EQ(content_of(folder / "audit.log"), begin + "1\"}\n" + begin + "2\"}\n");
  struct stat status {};
  ASSERT_EQ(stat((folder / "audit.log").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  EXPECT_TRUE(logged.empty());
}

TEST_F(AuditLogTest, TellsAllJobsOfABatchAndABlob) {
  AuditLog log(folder / "audit.log", clock, noted());
  CallRecord record = call("1");
  record.jobs = {"1", "2"};
  record.blob = "sha256:00";
  log.add(record);
  log.flush();
  EXPECT_THAT(content_of(folder / "audit.log"), ::testing::EndsWith(R"("jobs":["1","2"],"blob":"sha256:00"})"
                                                                    "\n"));
}

TEST_F(AuditLogTest, PutsFullFilesAsideAndKeepsTheNewest) {
  const AuditLimits limits{.file_bytes = 300, .files = 3, .waiting = 1000};
  AuditLog log(folder / "audit.log", clock, noted(), limits);
  for (int i = 0; i < 20; ++i) {
    log.add(call(std::to_string(i)));
    log.flush();
  }
  EXPECT_EQ(folder.count(), 3u);
  const std::string all =
      content_of(folder / "audit.log.2") + content_of(folder / "audit.log.1") + content_of(folder / "audit.log");
  EXPECT_THAT(all, ::testing::EndsWith("\"job\":\"19\"}\n"));
  // Each file is filled, and nothing between two files is lost: the numbers go down by one from the end.
  int expected = 19;
  for (auto at = all.rfind("\"job\""); at != std::string::npos && at > 0; at = all.rfind("\"job\"", at - 1))
    EXPECT_EQ(std::stoi(all.substr(at + 7)), expected--);
  EXPECT_LE(expected, 15);
}

TEST_F(AuditLogTest, ManyThreadsLoseNothing) {
  {
    AuditLog log(folder / "audit.log", clock, noted());
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        for (int i = 0; i < 500; ++i) log.add(call("x"));
      });
    for (auto& thread : threads) thread.join();
  }
  const std::string all = content_of(folder / "audit.log");
  EXPECT_EQ(std::count(all.begin(), all.end(), '\n'), 2000);
}

TEST_F(AuditLogTest, SaysOnceThatItCannotBeWritten) {
  AuditLog log("/dev/full", clock, noted());
  log.add(call("1"));
  log.flush();
  log.add(call("2"));
  log.flush();
  ASSERT_EQ(logged.size(), 1u);
  EXPECT_THAT(logged[0], ::testing::HasSubstr("entries are lost"));
}

}  // namespace
}  // namespace saltus::server
