#pragma once

#include "server/jobs/clock.h"
#include "server/rpc/call_record.h"

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace saltus::server {

struct AuditLimits {
  std::uintmax_t file_bytes = 64 << 20;  ///< a file that is longer is put aside: audit.log.1 is the newest of these
  int files = 16;                        ///< so many are kept, the present one included
  std::size_t waiting = 100000;          ///< entries that the disk has not taken yet; more are counted, not kept
};

/// Who has changed what, or tried to: one JSON object a line, appended, never with a name, a label or a token.
///
/// An entry is on its way when its call is answered, and synced to disk in one go with those that came in meanwhile: a
/// crash of the machine can lose the last few, a crash of the daemon those of the last milliseconds. Thread-safe.
class AuditLog {
 public:
  /// Throws std::runtime_error when the file cannot be opened. `log` is told, once, when entries cannot be written.
  AuditLog(std::filesystem::path file, const Clock& clock, std::function<void(const std::string& line)> log,
           AuditLimits limits = {});
  /// Writes what has come in.
  ~AuditLog();
  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;

  /// Never blocks.
  void add(const CallRecord& call);
  /// Returns when all that was added before is on disk, or could not be written.
  void flush();

 private:
  void run();
  void write(const std::string& lines);
  void open();
  void rotate();

  const std::filesystem::path file_;
  const Clock& clock_;
  const std::function<void(const std::string&)> log_;
  const AuditLimits limits_;
  int descriptor_ = -1;
  std::uintmax_t bytes_ = 0;
  bool has_failed_ = false;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> waiting_;
  std::uint64_t lost_ = 0;
  bool is_writing_ = false;
  bool is_closing_ = false;
  std::thread thread_;
};

}  // namespace saltus::server
