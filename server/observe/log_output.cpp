#include "server/observe/log_output.h"

#include "server/observe/json_line.h"
#include "server/observe/line_writer.h"
#include "server/observe/time_text.h"

#include <grpc/support/log.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <unistd.h>

#include <atomic>
#include <memory>
#include <mutex>

namespace saltus::server {
namespace {

std::atomic<bool> is_json{false};

spdlog::level::level_enum level_of(LogLine::Level level) {
  switch (level) {
    case LogLine::Level::Debug:
      return spdlog::level::debug;
    case LogLine::Level::Info:
      return spdlog::level::info;
    case LogLine::Level::Warning:
      return spdlog::level::warn;
    case LogLine::Level::Error:
      return spdlog::level::err;
  }
  return spdlog::level::err;
}

const char* name_of(LogLine::Level level) {
  switch (level) {
    case LogLine::Level::Debug:
      return "debug";
    case LogLine::Level::Info:
      return "info";
    case LogLine::Level::Warning:
      return "warning";
    case LogLine::Level::Error:
      return "error";
  }
  return "";
}

std::string json(const LogLine& line) {
  JsonLine object;
  object.add("ts", utc_text(SystemClock().wall())).add("level", name_of(line.level)).add("msg", line.message);
  if (!line.job.empty()) object.add("job", line.job);
  if (line.attempt > 0) object.add("attempt", std::int64_t{line.attempt});
  if (!line.submitter.empty()) object.add("submitter", line.submitter);
  return object.str();
}

std::string text(const LogLine& line) {
  std::string about;
  const auto add = [&](const std::string& what) { about += (about.empty() ? "" : ", ") + what; };
  if (!line.job.empty()) add("job " + line.job);
  if (line.attempt > 0) add("attempt " + std::to_string(line.attempt));
  if (!line.submitter.empty()) add("of " + line.submitter);
  return about.empty() ? line.message : line.message + " (" + about + ")";
}

std::string lost_line(std::uint64_t lost) {
  const LogLine line(LogLine::Level::Warning,
                     std::to_string(lost) + " log lines are missing here, because nobody has read standard error");
  return (is_json ? json(line) : line.message) + "\n";
}

/// Formats, and leaves the waiting to the writer's thread.
class QueuedSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  QueuedSink() : writer_(std::make_unique<LineWriter>(STDERR_FILENO, lost_line, LineWriter::Limits{})) {}

  void end() {
    std::unique_ptr<LineWriter> last;  // nobody waits while it ends
    {
      const std::lock_guard lock(mutex_);
      if (writer_) dropped_ = writer_->dropped();
      last = std::move(writer_);
    }
  }
  std::uint64_t dropped() {
    const std::lock_guard lock(mutex_);
    return writer_ ? writer_->dropped() : dropped_;
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (!writer_) return;
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    writer_->add(fmt::to_string(line));
  }
  void flush_() override {}

  std::unique_ptr<LineWriter> writer_;
  std::uint64_t dropped_ = 0;
};

/// Where the log goes. Threads of gRPC may write to the very end of the process, so it is never taken away.
struct Output {
  std::shared_ptr<QueuedSink> sink = std::make_shared<QueuedSink>();
  spdlog::logger logger{"saltusd", sink};
};
std::atomic<Output*> output = nullptr;

/// What gRPC finds worth an error (a stranger's failed handshake, say) is no error of the daemon.
void write_log_of_grpc(gpr_log_func_args* arguments) {
  write_log({arguments->severity == GPR_LOG_SEVERITY_ERROR ? LogLine::Level::Warning : LogLine::Level::Debug,
             std::string("gRPC: ") + arguments->message});
}

}  // namespace

void start_log(const std::string& level, LogFormat format) {
  is_json = format == LogFormat::Json;
  auto made = std::make_unique<Output>();
  made->logger.set_level(spdlog::level::from_str(level));
  if (is_json) made->logger.set_pattern("%v");
  output = made.release();
  gpr_set_log_function(write_log_of_grpc);
}

void end_log() {
  if (Output* const now = output) now->sink->end();
}

void write_log(const LogLine& line) {
  Output* const now = output;
  const auto level = level_of(line.level);
  if (!now || !now->logger.should_log(level)) return;
  now->logger.log(level, is_json ? json(line) : text(line));
}

std::uint64_t dropped_log_lines() {
  Output* const now = output;
  return now ? now->sink->dropped() : 0;
}

}  // namespace saltus::server
