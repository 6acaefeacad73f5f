#include "server/store/sqlite_job_store.h"

#include "core/support/failpoint.h"
#include "server/jobs/refusal.h"
#include "server/jobs/storage_state.h"
#include "server/store/disk_errors.h"
#include "server/store/schema.h"
#include "server/store/sqlite_job_table.h"

#include <sqlite3.h>

namespace saltus::server {
namespace {

// Keeps the latency of the first of a long queue bounded.
constexpr std::size_t kLargestGroup = 128;

[[noreturn]] void refuse_damaged(const std::filesystem::path& file, const std::string& reason) {
  throw std::runtime_error("the database " + file.string() + " is damaged (" + reason +
                           "); put a backup of it in its "
                           "place, or move the whole folder away and begin with an empty one");
}

/// Runs `work`; what SQLite says of a file that is no sound database becomes one sentence.
template <class Work>
auto explained(const std::filesystem::path& file, Work work) {
  try {
    return work();
  } catch (const DatabaseError& error) {
    if (error.code() == SQLITE_CORRUPT || error.code() == SQLITE_NOTADB) refuse_damaged(file, error.what());
    throw std::runtime_error("the database " + file.string() + " cannot be used: " + error.what());
  }
}

/// A daemon that was killed may have written to the log what it did not sync, and SQLite takes that for committed all
/// the same: it has to be on the disk before anybody is told of it. The log is synced first, then moved to the
/// database.
void make_durable(Database& database) {
  try {
    database.query("PRAGMA wal_checkpoint(PASSIVE)").run();
  } catch (const DatabaseError& error) {
    // The log is safe where it is; there is no room to move it.
    if (error.code() != SQLITE_FULL) throw;
  }
}

}  // namespace

void require_sound_database(const std::filesystem::path& file) {
  explained(file, [&] {
    Database database(file, Database::Access::ReadOnly);
    // Every page and every row; what an index says of them is not worth the time at each start.
    Query query = database.query("PRAGMA quick_check(1)");
    if (!query.step()) refuse_damaged(file, "its check says nothing");
    if (const std::string found = query.text(); found != "ok") refuse_damaged(file, found);
  });
}

SqliteJobStore::SqliteJobStore(std::filesystem::path file, std::function<void(const std::string&)> on_broken)
    : file_(std::move(file)), on_broken_(std::move(on_broken)), writer_(file_, Database::Access::ReadWrite) {
  explained(file_, [this] {
    prepare_schema(writer_);
    make_durable(writer_);
  });
  require_sound_database(file_);
  thread_ = std::thread([this] { run(); });
}

SqliteJobStore::~SqliteJobStore() {
  {
    std::lock_guard lock(mutex_);
    is_closing_ = true;
  }
  has_work_.notify_one();
  thread_.join();
}

void SqliteJobStore::write(Operation operation, Done done) {
  {
    std::lock_guard lock(mutex_);
    waiting_.push_back({std::move(operation), std::move(done), nullptr});
  }
  has_work_.notify_one();
}

void SqliteJobStore::run() {
  while (true) {
    std::vector<Write> group;
    {
      std::unique_lock lock(mutex_);
      has_work_.wait(lock, [this] { return is_closing_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      const std::size_t count = std::min(waiting_.size(), kLargestGroup);
      const auto end = waiting_.begin() + static_cast<std::ptrdiff_t>(count);
      group.assign(std::make_move_iterator(waiting_.begin()), std::make_move_iterator(end));
      waiting_.erase(waiting_.begin(), end);
    }
    const auto began = std::chrono::steady_clock::now();
    commit(group);
    if (on_commit_) on_commit_(std::chrono::steady_clock::now() - began, group.size());
    for (Write& write : group) {
      write.done(write.error);
      SALTUS_FAILPOINT("acknowledge.after");
    }
  }
}

void SqliteJobStore::run_one(Write& write) {
  writer_.execute("SAVEPOINT one");
  try {
    SqliteJobTable table(writer_);
    write.operation(table);
  } catch (const DatabaseError& error) {
    // Anything but a broken constraint may have ended the transaction of the whole group.
    if (error.code() != SQLITE_CONSTRAINT) throw;
    write.error = std::current_exception();
    writer_.execute("ROLLBACK TO one");
  } catch (...) {
    write.error = std::current_exception();
    writer_.execute("ROLLBACK TO one");
  }
  writer_.execute("RELEASE one");
}

void SqliteJobStore::commit(std::vector<Write>& group) {
  const auto fail_all = [&](const Refusal& refusal) {
    for (Write& write : group)
      if (!write.error) write.error = std::make_exception_ptr(refusal);
  };
  if (is_broken_) return fail_all(StorageState::refusal());
  try {
    writer_.execute("BEGIN IMMEDIATE");
    for (Write& write : group) run_one(write);
    SALTUS_FAILPOINT("commit.before");
    writer_.execute("COMMIT");
    SALTUS_FAILPOINT("commit.after");
  } catch (const DatabaseError& error) {
    const bool is_full = error.code() == SQLITE_FULL;
    std::string reason = error.what();
    try {
      if (writer_.is_in_transaction()) writer_.execute("ROLLBACK");
    } catch (const DatabaseError& again) {
      reason += "; and then " + std::string(again.what());
      is_broken_ = true;
    }
    if (is_full && !is_broken_) return fail_all(storage_full());
    is_broken_ = true;
    fail_all(StorageState::refusal());
    on_broken_(reason);
  }
}

std::unique_ptr<Database> SqliteJobStore::take_reader() {
  {
    std::lock_guard lock(readers_mutex_);
    if (!readers_.empty()) {
      auto reader = std::move(readers_.back());
      readers_.pop_back();
      return reader;
    }
  }
  return std::make_unique<Database>(file_, Database::Access::ReadOnly);
}

void SqliteJobStore::read(const std::function<void(JobReader&)>& operation) {
  auto reader = take_reader();
  reader->execute("BEGIN");
  std::exception_ptr refusal;
  try {
    SqliteJobTable table(*reader);
    operation(table);
  } catch (const Refusal&) {
    refusal = std::current_exception();
  }
  // After any other exception the connection is closed, and its transaction with it.
  reader->execute("COMMIT");
  {
    std::lock_guard lock(readers_mutex_);
    readers_.push_back(std::move(reader));
  }
  if (refusal) std::rethrow_exception(refusal);
}

std::vector<std::string> SqliteJobStore::blobs() {
  auto reader = take_reader();
  return SqliteJobTable(*reader).blobs();
}

}  // namespace saltus::server
