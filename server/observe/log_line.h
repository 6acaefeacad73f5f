#pragma once

#include <string>

namespace saltus::server {

/// One thing that has happened. Never a token, a file name, a label, or anything that a client's image says.
struct LogLine {
  enum class Level { Debug, Info, Warning, Error };

  LogLine(std::string text) : message(std::move(text)) {}
  LogLine(const char* text) : message(text) {}
  LogLine(Level how_bad, std::string text) : level(how_bad), message(std::move(text)) {}

  Level level = Level::Info;
  std::string message;
  // Of the job that it is about, if any.
  std::string job;
  int attempt = 0;
  std::string submitter;
};

}  // namespace saltus::server
