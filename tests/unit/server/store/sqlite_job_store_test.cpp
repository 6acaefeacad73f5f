#include "server/store/sqlite_job_store.h"

#include "server/jobs/refusal.h"
#include "server/store/schema.h"
#include "tests/crash/synced_copy.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <future>

namespace saltus::server {
namespace {

void expect_intact(const std::string& reason) { ADD_FAILURE() << "the store broke: " << reason; }

std::future<void> insert(JobStore& store, const std::string& id) {
  auto done = std::make_shared<std::promise<void>>();
  store.write(
      [id](JobTable& table) {
        JobRecord job;
        job.id = id;
        table.insert(job);
      },
      [done](std::exception_ptr error) { error ? done->set_exception(error) : done->set_value(); });
  return done->get_future();
}

bool has(JobStore& store, const std::string& id) {
  bool found = false;
  store.read([&](JobReader& reader) { found = reader.find(id).has_value(); });
  return found;
}

TEST(SqliteJobStore, WhatWasAnsweredIsThereAfterReopening) {
  testing_support::TemporaryFolder folder;
  {
    SqliteJobStore store(folder / "db", expect_intact);
    insert(store, "a").get();
  }
  SqliteJobStore store(folder / "db", expect_intact);
  EXPECT_TRUE(has(store, "a"));
}

// A copy of the files while the store is open is what the disk holds after a crash of the process.
TEST(SqliteJobStore, WhatWasAnsweredIsThereAfterACrash) {
  testing_support::TemporaryFolder folder;
  SqliteJobStore store(folder / "db", expect_intact);
  for (int i = 0; i < 20; ++i) insert(store, "job-" + std::to_string(i)).get();
  testing_support::TemporaryFolder crashed;
  for (const char* name : {"db", "db-wal"}) std::filesystem::copy(folder / name, crashed / name);
  SqliteJobStore recovered(crashed / "db", expect_intact);
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(has(recovered, "job-" + std::to_string(i)));
}

// SQLite reads what a killed process has written and not synced. Whoever is told of it then must be able to rely on it.
TEST(SqliteJobStore, WhatIsReadAfterACrashSurvivesAPowerCut) {
  testing_support::TemporaryFolder folder, crashed, synced, after_power_cut;
  {
    SqliteJobStore store(folder / "db", expect_intact);
    insert(store, "a").get();
    for (const char* name : {"db", "db-wal"}) std::filesystem::copy(folder / name, crashed / name);
  }
  const crash::SyncedCopies copies(synced.path());
  SqliteJobStore recovered(crashed / "db", expect_intact);
  ASSERT_TRUE(has(recovered, "a"));
  for (const auto& copy : std::filesystem::directory_iterator(synced.path()))
    std::filesystem::copy(copy.path(), after_power_cut / copy.path().filename());
  SqliteJobStore store(after_power_cut / "db", expect_intact);
  EXPECT_TRUE(has(store, "a"));
}

TEST(SqliteJobStore, AnswersInTheOrderOfTheOperations) {
  testing_support::TemporaryFolder folder;
  std::vector<int> order;
  {
    SqliteJobStore store(folder / "db", expect_intact);
    for (int i = 0; i < 300; ++i)
      store.write([](JobTable&) {}, [&order, i](std::exception_ptr) { order.push_back(i); });
  }
  ASSERT_EQ(order.size(), 300u);
  for (int i = 0; i < 300; ++i) EXPECT_EQ(order[i], i);
}

TEST(SqliteJobStore, NothingIsAnsweredBeforeItIsCommitted) {
  testing_support::TemporaryFolder folder;
  SqliteJobStore store(folder / "db", expect_intact);
  std::promise<bool> was_visible;
  store.write(
      [](JobTable& table) {
        JobRecord job;
        job.id = "a";
        table.insert(job);
      },
      // Another connection sees committed rows only.
      [&](std::exception_ptr) { was_visible.set_value(has(store, "a")); });
  EXPECT_TRUE(was_visible.get_future().get());
}

TEST(SqliteJobStore, AFailedOperationDoesNotHarmItsNeighboursInTheSameCommit) {
  testing_support::TemporaryFolder folder;
  SqliteJobStore store(folder / "db", expect_intact);
  // The gate keeps the writing thread busy until all three wait, so that they are committed together.
  std::promise<void> gate;
  auto opened = gate.get_future().share();
  store.write([](JobTable&) {}, [opened](std::exception_ptr) { opened.wait(); });
  auto first = insert(store, "a");
  auto duplicate = insert(store, "a");
  auto other = insert(store, "b");
  gate.set_value();
  first.get();
  EXPECT_ANY_THROW(duplicate.get());
  other.get();
  EXPECT_TRUE(has(store, "b"));
}

TEST(SqliteJobStore, ARefusalOfAReaderLeavesItsConnectionUsable) {
  testing_support::TemporaryFolder folder;
  SqliteJobStore store(folder / "db", expect_intact);
  for (int i = 0; i < 3; ++i)
    EXPECT_THROW(store.read([](JobReader&) { throw Refusal(RefusalKind::NotFound, "X", "x"); }), Refusal);
  insert(store, "a").get();
  EXPECT_TRUE(has(store, "a"));
}

TEST(SqliteJobStore, RefusesADatabaseOfANewerVersion) {
  testing_support::TemporaryFolder folder;
  { SqliteJobStore store(folder / "db", expect_intact); }
  Database(folder / "db", Database::Access::ReadWrite)
      .execute("PRAGMA user_version=" + std::to_string(kSchemaVersion + 1));
  try {
    SqliteJobStore store(folder / "db", expect_intact);
    FAIL() << "was opened";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("newer saltusd"), std::string::npos) << error.what();
  }
}

TEST(SqliteJobStore, RefusesADatabaseOfAnotherProgram) {
  testing_support::TemporaryFolder folder;
  Database(folder / "db", Database::Access::ReadWrite).execute("CREATE TABLE x (y); PRAGMA user_version=1");
  EXPECT_THROW(SqliteJobStore(folder / "db", expect_intact), std::runtime_error);
}

TEST(SqliteJobStore, SaysSoOnceWhenTheDatabaseIsDamagedAndRefusesFromThenOn) {
  testing_support::TemporaryFolder folder;
  int broken = 0;
  {
    SqliteJobStore store(folder / "db", [&](const std::string&) { ++broken; });
    insert(store, "a").get();
    std::promise<void> done;
    store.write([](JobTable&) { throw DatabaseError(10 /* SQLITE_IOERR */, "fsync failed"); },
                [&](std::exception_ptr) { done.set_value(); });
    done.get_future().get();
    for (int i = 0; i < 2; ++i) {
      try {
        insert(store, "b").get();
        FAIL() << "was accepted";
      } catch (const Refusal& refusal) {
        EXPECT_EQ(refusal.reason(), "STORE_UNAVAILABLE");
      }
    }
    EXPECT_TRUE(has(store, "a"));
  }
  EXPECT_EQ(broken, 1);
}

TEST(SqliteJobStore, AFullDiskRefusesOneCommitAndIsNotTheEnd) {
  testing_support::TemporaryFolder folder;
  SqliteJobStore store(folder / "db", expect_intact);
  std::promise<void> done;
  store.write([](JobTable&) { throw DatabaseError(13 /* SQLITE_FULL */, "disk full"); },
              [&](std::exception_ptr error) { error ? done.set_exception(error) : done.set_value(); });
  try {
    done.get_future().get();
    FAIL() << "was accepted";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.reason(), "STORAGE_FULL");
  }
  insert(store, "a").get();
  EXPECT_TRUE(has(store, "a"));
}

}  // namespace
}  // namespace saltus::server
