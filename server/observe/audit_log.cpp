#include "server/observe/audit_log.h"

#include "server/observe/json_line.h"
#include "server/observe/time_text.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace saltus::server {
namespace fs = std::filesystem;

AuditLog::AuditLog(fs::path file, const Clock& clock, std::function<void(const std::string&)> log, AuditLimits limits)
    : file_(std::move(file)), clock_(clock), log_(std::move(log)), limits_(limits) {
  open();
  thread_ = std::thread([this] { run(); });
}

AuditLog::~AuditLog() {
  {
    std::lock_guard lock(mutex_);
    is_closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
  ::close(descriptor_);
}

void AuditLog::open() {
  descriptor_ = ::open(file_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  struct stat status {};
  if (descriptor_ < 0 || ::fstat(descriptor_, &status) != 0)
    throw std::runtime_error("cannot open " + file_.string() + ": " + std::strerror(errno));
  bytes_ = static_cast<std::uintmax_t>(status.st_size);
}

void AuditLog::add(const CallRecord& call) {
  JsonLine line;
  line.add("time", utc_text(clock_.wall()))
      .add("identity", call.identity)
      .add("peer", call.is_local ? "local" : "tls")
      .add("method", call.method)
      .add("code", call.code);
  if (call.jobs.size() == 1) line.add("job", call.jobs.front());
  if (call.jobs.size() > 1) line.add("jobs", call.jobs);
  if (!call.blob.empty()) line.add("blob", call.blob);
  {
    std::lock_guard lock(mutex_);
    if (waiting_.size() < limits_.waiting)
      waiting_.push_back(line.str() + "\n");
    else
      ++lost_;
  }
  changed_.notify_all();
}

void AuditLog::flush() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return waiting_.empty() && !is_writing_; });
}

void AuditLog::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return is_closing_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    std::vector<std::string> group;
    group.swap(waiting_);
    const std::uint64_t lost = std::exchange(lost_, 0);
    is_writing_ = true;
    lock.unlock();
    std::string lines;
    for (const std::string& line : group) lines += line;
    if (lost > 0)
      lines +=
          JsonLine().add("time", utc_text(clock_.wall())).add("lost", static_cast<std::int64_t>(lost)).str() + "\n";
    write(lines);
    lock.lock();
    is_writing_ = false;
    changed_.notify_all();
  }
}

void AuditLog::write(const std::string& lines) {
  try {
    if (bytes_ > 0 && bytes_ + lines.size() > limits_.file_bytes) rotate();
    for (std::size_t at = 0; at < lines.size();) {
      const ssize_t count = ::write(descriptor_, lines.data() + at, lines.size() - at);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) throw std::runtime_error(std::strerror(errno));
      at += static_cast<std::size_t>(count);
      bytes_ += static_cast<std::uintmax_t>(count);
    }
    if (::fdatasync(descriptor_) != 0) throw std::runtime_error(std::strerror(errno));
    has_failed_ = false;
  } catch (const std::exception& error) {
    if (!has_failed_) log_(std::string("the audit log cannot be written, entries are lost: ") + error.what());
    has_failed_ = true;
  }
}

void AuditLog::rotate() {
  const auto aside = [this](int number) { return fs::path(file_.string() + "." + std::to_string(number)); };
  for (int number = limits_.files - 1; number > 0; --number) {
    const fs::path from = number == 1 ? file_ : aside(number - 1);
    if (fs::exists(from)) fs::rename(from, aside(number));
  }
  ::close(descriptor_);
  open();
}

}  // namespace saltus::server
