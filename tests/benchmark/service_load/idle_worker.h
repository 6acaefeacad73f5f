#pragma once

#include <string>

namespace saltus::benchmark {

/// What the daemon tells a worker on its command line.
struct WorkerOptions {
  std::string server, job, token_file;
  int attempt = 0;
};

/// Takes its lease and reports one more iteration several times a second, until the daemon wants it to end or is gone.
void work_idly(const WorkerOptions& options);

}  // namespace saltus::benchmark
