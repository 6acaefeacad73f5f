#pragma once

#include "server/observe/log_line.h"

#include <string>

namespace saltus::server {

enum class LogFormat {
  Text,
  Json,  ///< one object a line: ts, level, msg, and job, attempt, submitter where there is one
};

/// Sends the log to standard error, gRPC's own too. `level`: trace, debug, info, warning, error or off. To be called
/// before any other thread is there.
void start_log(const std::string& level, LogFormat format);
/// Waits a moment for what was written to be taken; what is written from now on is lost. When no other thread writes.
void end_log();
/// From any thread. Never blocks: while nobody reads standard error, lines are dropped and counted.
void write_log(const LogLine& line);

}  // namespace saltus::server
