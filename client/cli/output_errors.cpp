#include "client/cli/output_errors.h"

#include <csignal>
#include <cstdio>
#include <iostream>

namespace saltus::cli {

void let_writes_fail() {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

bool has_output_arrived() {
  std::cout.flush();
  return std::cout.good() && std::fflush(stdout) == 0 && std::ferror(stdout) == 0;
}

}  // namespace saltus::cli
