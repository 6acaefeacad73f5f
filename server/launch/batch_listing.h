#pragma once

#include "server/jobs/launcher.h"
#include "server/launch/command.h"

#include <optional>
#include <string>
#include <vector>

namespace saltus::server {

/// One line of squeue.
struct BatchRow {
  std::string id;  ///< what scancel takes: "17", or "17_3" of an array
  std::string name;
  std::string state;    ///< the long form: "RUNNING"
  int wait_status = 0;  ///< as of waitpid, once it has ended
};

/// The call of squeue: all jobs of this user that Slurm still knows, ended ones too.
Command listing();
/// What that printed. Nothing when it is not what was asked for.
std::optional<std::vector<BatchRow>> parse_listing(const std::string& text);

/// It has not begun: no machine runs it.
bool is_pending(const BatchRow& row);
/// How it has ended; nothing when it has not, or Slurm says a word that this program does not know.
std::optional<WorkerExit> end_of(const BatchRow& row);

}  // namespace saltus::server
