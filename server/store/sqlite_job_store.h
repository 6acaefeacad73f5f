#pragma once

#include "server/jobs/job_store.h"
#include "server/store/database.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace saltus::server {

/// Throws std::runtime_error, with the file's name and what to do, when the database is damaged. Reads all of it.
void require_sound_database(const std::filesystem::path& file);

/// Jobs in one SQLite file. One thread owns the writing connection and commits what has queued up in one go (an fsync
/// costs milliseconds, a row microseconds); readers have connections of their own and never wait for it.
///
/// A full disk refuses the operations of that commit with STORAGE_FULL. Any other failure of the database is final: an
/// fsync that failed cannot be repeated. From then on writes are refused with STORE_UNAVAILABLE, and `on_broken` is
/// called once; reading goes on.
class SqliteJobStore final : public JobStore {
 public:
  /// Throws std::runtime_error when the file cannot be used: one sentence with its name and the way out.
  SqliteJobStore(std::filesystem::path file, std::function<void(const std::string& reason)> on_broken);
  /// Finishes what was handed in before.
  ~SqliteJobStore() override;

  void write(Operation operation, Done done) override;
  void read(const std::function<void(JobReader&)>& operation) override;

  /// From now on as after a failure of the database, because another part of the disk has failed.
  void refuse_writes() { is_broken_ = true; }

  /// Is told, on the writing thread, how long each commit took and how many operations it made durable. To be called
  /// before the first write.
  void on_commit(std::function<void(std::chrono::steady_clock::duration, std::size_t)> told) {
    on_commit_ = std::move(told);
  }

  /// Digests of all blobs. Blocks.
  std::vector<std::string> blobs();

 private:
  struct Write {
    Operation operation;
    Done done;
    std::exception_ptr error;
  };
  void run();
  void commit(std::vector<Write>& group);
  void run_one(Write& write);
  std::unique_ptr<Database> take_reader();

  const std::filesystem::path file_;
  const std::function<void(const std::string&)> on_broken_;
  std::function<void(std::chrono::steady_clock::duration, std::size_t)> on_commit_;
  Database writer_;

  std::mutex mutex_;
  std::condition_variable has_work_;
  std::vector<Write> waiting_;
  bool is_closing_ = false;
  std::atomic<bool> is_broken_{false};

  std::mutex readers_mutex_;
  std::vector<std::unique_ptr<Database>> readers_;

  std::thread thread_;
};

}  // namespace saltus::server
