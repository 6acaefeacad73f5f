#pragma once

#include "client/cli/command_line.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace saltus::testing_support {

struct CapturedRun {
  int exit_code;
  std::string out, err;
};

/// `saltus WORDS...` in this process, with what it would have written to the terminal.
inline CapturedRun run_command_line_captured(std::vector<std::string> words) {
  words.insert(words.begin(), "saltus");
  std::vector<const char*> arguments;
  for (const std::string& word : words) arguments.push_back(word.c_str());
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const int exit_code = cli::run_command_line(static_cast<int>(arguments.size()), arguments.data());
  return {exit_code, testing::internal::GetCapturedStdout(), testing::internal::GetCapturedStderr()};
}

}  // namespace saltus::testing_support
