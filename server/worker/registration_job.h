#pragma once

#include "core/registration/checkpoint.h"
#include "core/registration/progress.h"
#include "server/worker/registration_task.h"

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace saltus::worker {

enum class TaskStage { Validating, Optimising, Writing };

/// Hears of the beginning of each stage and then, while optimising, of each evaluation. `progress` is empty outside of
/// Optimising.
using TaskObserver = std::function<ProgressAnswer(TaskStage stage, const Progress& progress)>;

/// How a task can be interrupted and taken up again.
struct TaskCheckpoints {
  std::optional<std::filesystem::path> resume;       ///< a checkpoint of an earlier run of the same task
  CheckpointCallback offer;                          ///< see core/registration/checkpoint.h; may be empty
  std::function<void(const std::string&)> on_unfit;  ///< `resume` cannot be used, for this reason; may be empty
};

/// Reads the inputs, registers, and writes into `folder`: displacement, inverse_displacement, warped and jacobian in
/// the output format, the initial momenta (momentum_<n>_order<o>, one file each, coarse to fine as in report.json),
/// transform.h5, interface.csv and interface.vtp (core/slip/slip_surface.h), report.json and report.html. Returns the
/// names of the files. Throws TaskFailure or TaskStopped; messages name files without their folder. A checkpoint that
/// does not fit the task is dropped: it never changes what comes out.
std::vector<std::string> run_registration_task(const RegistrationTask& task, const std::filesystem::path& folder,
                                               const TaskObserver& observer, const TaskCheckpoints& checkpoints = {});

}  // namespace saltus::worker
