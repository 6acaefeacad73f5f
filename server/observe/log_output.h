#pragma once

#include "server/observe/log_line.h"

#include <cstdint>
#include <string>

namespace saltus::server {

enum class LogFormat {
  Text,
  Json,  ///< one object a line: ts, level, msg, and job, attempt, submitter where there is one
};

/// Sends the log to standard error, gRPC's own too. `level`: trace, debug, info, warning, error or off. To be called
/// once, before any other thread is there; what is written before is lost.
void start_log(const std::string& level, LogFormat format);
/// Waits a moment for what was written to be taken; what is written from now on is lost. Other threads may still write.
void end_log();
/// From any thread. Never blocks: while nobody reads standard error, lines are dropped and counted.
void write_log(const LogLine& line);
/// How many lines were dropped so far.
std::uint64_t dropped_log_lines();

}  // namespace saltus::server
