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
  std::string host;     ///< of its first process; "" before it begins
  std::string reason;   ///< why it is in that state: "Resources"; "" when there is none
};

/// The call of squeue: all jobs of this user that Slurm still knows, ended ones too.
Command listing();
/// What that printed. Nothing when it is not what was asked for.
std::optional<std::vector<BatchRow>> parse_listing(const std::string& text);

/// It has not begun: no machine runs it.
bool is_pending(const BatchRow& row);
/// It waits, and will do so until the job, the partition or its nodes are changed.
bool can_never_start(const BatchRow& row);
/// What sbatch refuses because no node could run it stays in the queue for a while, as a job that has failed.
bool was_never_possible(const BatchRow& row);
/// How it has ended; nothing when it has not, or Slurm says a word that this program does not know.
std::optional<WorkerExit> end_of(const BatchRow& row);

}  // namespace saltus::server
