#include "server/worker/worker_session.h"

#include "client/lib/blob_transfer.h"
#include "client/lib/client_error.h"
#include "core/support/errors.h"
#include "core/support/failpoint.h"
#include "server/worker/checkpoint_keeper.h"
#include "server/worker/process_limits.h"
#include "server/worker/registration_job.h"
#include "server/worker/result_sender.h"
#include "server/worker/work_folder.h"

#include <algorithm>
#include <exception>
#include <fstream>
#include <iostream>
#include <new>

#include <unistd.h>

namespace saltus::worker {
namespace {

// Results that are computed are worth more patience than a lease lasts: somebody may be making room on the disk. Less
// than the daemon takes by default to call an attempt stalled.
constexpr std::chrono::minutes room_patience{10};

WorkerExit exit_for(StopReason reason) {
  switch (reason) {
    case StopReason::Cancelled:
      return OutcomeReported;
    case StopReason::LeaseLost:
      return LeaseLostExit;
    case StopReason::Unreachable:
      return DaemonUnreachable;
    case StopReason::Terminated:
      return TerminatedExit;
    case StopReason::CpuTime:
      return OutcomeReported;
    case StopReason::None:
      break;
  }
  return InternalError;
}

WorkerExit exit_for(const client::ClientError& error) {
  std::cerr << "saltus-worker: " << error.what() << std::endl;
  if (error.code() == grpc::StatusCode::ABORTED) return LeaseLostExit;
  if (memory_is_used_up()) return OutOfMemoryExit;
  if (error.reason() == "STORAGE_FULL") return NoRoomExit;
  return error.code() == grpc::StatusCode::UNAVAILABLE ? DaemonUnreachable : InternalError;
}

void report_memory_limit(Lease& lease) {
  note_memory_is_used_up();
  lease.complete_failure("MEMORY_LIMIT",
                         "the job needs more memory than it may use; crop the fixed image, set finest_level to 1, or "
                         "give the job more memory");
}

/// Tells the daemon that the work stopped because it was asked to, if that is an outcome.
void report_stopped(Lease& lease) {
  if (lease.stop_reason() == StopReason::Cancelled) lease.complete_cancelled();
  if (lease.stop_reason() == StopReason::CpuTime)
    lease.complete_failure("CPU_TIME",
                           "the job used more processor time than it may; crop the fixed image, take the preset fast, "
                           "or give the job more time");
}

WorkerExit finish_stopped(Lease& lease) {
  report_stopped(lease);
  return exit_for(lease.stop_reason());
}

void report_stage(Lease& lease, v1::JobStage stage) {
  v1::JobProgress progress;
  progress.set_stage(stage);
  progress.set_seconds_left(-1);
  lease.set_progress(progress);
}

v1::JobStage stage_of(TaskStage stage) {
  switch (stage) {
    case TaskStage::Validating:
      return v1::JOB_STAGE_VALIDATING;
    case TaskStage::Optimising:
      return v1::JOB_STAGE_OPTIMISING;
    case TaskStage::Writing:
      return v1::JOB_STAGE_WRITING;
  }
  return v1::JOB_STAGE_UNSPECIFIED;
}

v1::JobProgress progress_of(TaskStage stage, const Progress& progress) {
  v1::JobProgress message;
  message.set_stage(stage_of(stage));
  message.set_level(progress.level);
  message.set_levels(progress.levels);
  message.set_iteration(progress.iteration);
  message.set_max_iterations(progress.max_iterations);
  message.set_energy(progress.energy);
  message.set_similarity(progress.similarity);
  message.set_fraction(progress.fraction);
  message.set_seconds_left(progress.seconds_left);
  return message;
}

AffineStart affine_of(v1::AffineStart start) {
  if (start == v1::AFFINE_START_RIGID) return AffineStart::Rigid;
  if (start == v1::AFFINE_START_AFFINE) return AffineStart::Affine;
  return AffineStart::None;
}

/// A message may quote a damaged file; it travels as UTF-8 text of limited length.
std::string fit_for_transport(std::string message) {
  constexpr std::size_t longest = 2000;
  if (message.size() > longest) message.resize(longest);
  for (char& character : message)
    if (character < ' ' || character > '~') character = '?';
  return message;
}

/// Downloads the inputs and says where they are.
RegistrationTask fetch_task(const v1::AcquireLeaseResponse& terms, client::BlobTransfer& blobs,
                            const std::filesystem::path& folder) {
  const v1::RegistrationSpec& spec = terms.spec();
  RegistrationTask task;
  const auto fetch = [&](const v1::InputFile& input, const std::string& name) {
    const std::filesystem::path file = folder / (name + "." + input.format());
    blobs.download(input.digest(), file);
    task.digests[name] = input.digest();
    return file;
  };
  task.fixed = fetch(spec.fixed(), "fixed");
  task.moving = fetch(spec.moving(), "moving");
  if (spec.has_fixed_mask()) task.fixed_mask = fetch(spec.fixed_mask(), "fixed_mask");
  if (spec.has_moving_mask()) task.moving_mask = fetch(spec.moving_mask(), "moving_mask");
  if (spec.has_fixed_points()) task.fixed_points = fetch(spec.fixed_points(), "fixed_points");
  if (spec.has_moving_points()) task.moving_points = fetch(spec.moving_points(), "moving_points");
  task.model = spec.model();
  task.similarity = spec.similarity();
  task.preset = spec.preset();
  task.settings.insert(spec.settings().begin(), spec.settings().end());
  task.affine = affine_of(spec.affine());
  if (spec.has_intensity_window())
    task.intensity_window = {spec.intensity_window().low(), spec.intensity_window().high()};
  if (spec.has_crop())
    task.crop = {{spec.crop().begin().begin(), spec.crop().begin().end()},
                 {spec.crop().end().begin(), spec.crop().end().end()}};
  task.output_format = spec.output_format();
  task.threads = terms.threads() > 0 ? terms.threads() : 1;
  return task;
}

/// Where an earlier attempt stood, as a file. Nothing when there was none, or when it cannot be had: the job is then
/// done from the start.
std::optional<std::filesystem::path> fetch_checkpoint(const v1::AcquireLeaseResponse& terms,
                                                      client::BlobTransfer& blobs,
                                                      const std::filesystem::path& folder) {
  if (!terms.has_checkpoint()) return std::nullopt;
  const std::filesystem::path file = folder / "checkpoint";
  try {
    blobs.download(terms.checkpoint().digest(), file);
    return file;
  } catch (const client::ClientError& error) {
    if (error.code() != grpc::StatusCode::NOT_FOUND && error.code() != grpc::StatusCode::DATA_LOSS) throw;
    std::cerr << "saltus-worker: the checkpoint is dropped: " << error.what() << std::endl;
    return std::nullopt;
  }
}

/// Writes a checkpoint where it is sent from. Throws FileError.
void write_checkpoint(const MakeCheckpoint& make, const std::filesystem::path& file) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  make(out);
  out.close();
  if (!out) throw FileError(file.filename().string() + " cannot be written");
}

/// Sends the checkpoint in `file` over a connection of its own. `place` is where it was made; the keeper makes no other
/// one before that is safe.
CheckpointKeeper::Put put_with(Lease& lease, const AttemptIdentity& identity, const std::filesystem::path& file,
                               const Progress& place) {
  const auto channel = client::make_channel(identity.server, identity.tls);
  return [&lease, &place, channel, file](const std::stop_token& stop) {
    client::CallSettings settings = lease.transfer_settings();
    settings.stop = stop;
    const client::FileDigest sent = client::BlobTransfer(channel, settings).upload(file);
    v1::Checkpoint checkpoint;
    checkpoint.set_digest(sent.digest);
    checkpoint.set_size(sent.size);
    checkpoint.set_level(place.level);
    checkpoint.set_iteration(place.iteration);
    lease.put_checkpoint(checkpoint, stop);
  };
}

/// Runs the registration with checkpoints; the names of the files in `results`.
std::vector<std::string> register_with_checkpoints(const RegistrationTask& task, Lease& lease,
                                                   const AttemptIdentity& identity,
                                                   const std::optional<std::filesystem::path>& checkpoint,
                                                   const std::filesystem::path& folder,
                                                   const std::filesystem::path& results) {
  const auto interval =
      std::chrono::milliseconds(static_cast<std::int64_t>(1000 * lease.terms().checkpoint_interval_seconds()));
  Progress place;
  const std::filesystem::path file = folder / "checkpoint.new";
  CheckpointKeeper keeper(interval, put_with(lease, identity, file, place), lease.stop_token());
  bool is_unfit = !checkpoint, is_resumed = false;
  TaskCheckpoints checkpoints;
  checkpoints.resume = checkpoint;
  checkpoints.offer = [&](const Progress& now, const MakeCheckpoint& make) {
    keeper.offer([&] {
      place = now;
      write_checkpoint(make, file);
    });
  };
  checkpoints.on_unfit = [&is_unfit](const std::string& why) {
    is_unfit = true;
    std::cerr << "saltus-worker: the checkpoint is dropped: " << why << std::endl;
  };
  const auto observe = [&](TaskStage stage, const Progress& progress) {
    if (stage == TaskStage::Optimising) SALTUS_FAILPOINT("worker.iteration");
    v1::JobProgress message = progress_of(stage, progress);
    is_resumed = is_resumed || (!is_unfit && progress.levels > 0);
    message.set_checkpoints(keeper.kept());
    message.set_is_resumed(is_resumed);
    lease.set_progress(message);
    return lease.stop_reason() == StopReason::None ? ProgressAnswer::Continue : ProgressAnswer::Stop;
  };
  return run_registration_task(task, results, observe, checkpoints);
}

WorkerExit work(Lease& lease, const AttemptIdentity& identity, const WorkFolder& work_folder) {
  const std::filesystem::path& folder = work_folder.path();
  client::BlobTransfer blobs(client::make_channel(identity.server, identity.tls), lease.transfer_settings());
  try {
    report_stage(lease, v1::JOB_STAGE_FETCHING);
    const RegistrationTask task = fetch_task(lease.terms(), blobs, folder);
    const auto checkpoint = fetch_checkpoint(lease.terms(), blobs, folder);

    const std::filesystem::path results = folder / "results";
    std::filesystem::create_directory(results);
    const auto names = register_with_checkpoints(task, lease, identity, checkpoint, folder, results);

    // A daemon that is away is not waited for so long: the lease then ends, and with it the transfer.
    client::CallSettings patient = lease.transfer_settings();
    patient.retry.patience = std::max<std::chrono::milliseconds>(patient.retry.patience, room_patience);
    const auto channel = client::make_channel(identity.server, identity.tls);
    const auto send = [&](std::size_t index, const std::stop_token& stop) {
      client::CallSettings settings = patient;
      settings.stop = stop;
      SALTUS_FAILPOINT("worker.upload.before");
      const auto sent = client::BlobTransfer(channel, settings).give(results / names[index], std::to_string(index));
      SALTUS_FAILPOINT("worker.upload.after");
      return sent;
    };
    lease.complete_success(send_results(names, send, lease.stop_token()));
    return OutcomeReported;
  } catch (const TaskStopped&) {
    return finish_stopped(lease);
  } catch (const TaskFailure& failure) {
    // That says nothing about the job: with room, or on another machine, the next attempt ends it.
    if (failure.reason() == "OUTPUT_UNWRITABLE" && !work_folder.can_be_written()) {
      std::cerr << "saltus-worker: there is no room for temporary files: " << failure.what() << std::endl;
      return NoRoomExit;
    }
    failure.reason() == "MEMORY_LIMIT" ? note_memory_is_used_up() : release_reserve();
    lease.complete_failure(failure.reason(), fit_for_transport(failure.what()));
    return OutcomeReported;
  } catch (const client::ClientError& error) {
    // A transfer that was cut off is no error of its own.
    if (error.code() == grpc::StatusCode::CANCELLED && lease.stop_reason() != StopReason::None)
      return finish_stopped(lease);
    if (error.code() == grpc::StatusCode::NOT_FOUND || error.code() == grpc::StatusCode::DATA_LOSS) {
      lease.complete_failure("INPUT_MISSING", std::string("an input is no longer on the server (") + error.what() +
                                                  "); submit the job again");
      return OutcomeReported;
    }
    // The next attempt would make the same file, for the same daemon.
    if (error.reason() == "FILE_TOO_LARGE") {
      lease.complete_failure("FILE_TOO_LARGE", std::string("a result cannot be delivered: ") + error.what());
      return OutcomeReported;
    }
    throw;
  } catch (const std::bad_alloc&) {
    report_memory_limit(lease);
    return OutcomeReported;
  }
}

/// For the handler below, which takes no arguments.
Lease* lease_of_process = nullptr;
WorkFolder* folder_of_process = nullptr;

/// An exception that nothing catches ends the process; thrown in a loop of many threads none can be caught outside of
/// it. When it is for want of memory, the daemon is told first: the same input would come to the same end again. A
/// daemon that cannot be told sees it from the exit code.
void report_and_end() {
  release_reserve();
  try {
    if (const auto error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    try {
      report_memory_limit(*lease_of_process);
      folder_of_process->remove();
      _exit(OutcomeReported);
    } catch (const client::ClientError& error) {
      _exit(exit_for(error));
    } catch (const std::exception& error) {
      std::cerr << "saltus-worker: out of memory, which could not be reported: " << error.what() << std::endl;
      _exit(OutOfMemoryExit);
    }
  } catch (const std::exception& error) {
    std::cerr << "saltus-worker: " << error.what() << std::endl;
  } catch (...) {
    std::cerr << "saltus-worker: an exception of an unknown type" << std::endl;
  }
  std::abort();
}

}  // namespace

WorkerExit run_attempt(const AttemptIdentity& identity) {
  try {
    WorkFolder folder;
    Lease lease(identity, [&folder](Lease& late) {
      // The solver is deep in one evaluation, or in ITK, and does not look up. What it would make is not wanted.
      try {
        report_stopped(late);
      } catch (const client::ClientError& error) {
        std::cerr << "saltus-worker: the outcome could not be reported: " << error.what() << std::endl;
      }
      folder.remove();
      _exit(exit_for(late.stop_reason()));
    });
    lease_of_process = &lease;
    folder_of_process = &folder;
    std::set_terminate(report_and_end);
    exit_when_out_of_memory(OutOfMemoryExit);
    limit_process(lease.terms().limits().memory_bytes(), lease.terms().limits().cpu_seconds(), lease.terms().threads());
    const WorkerExit exit = work(lease, identity, folder);
    std::set_terminate(std::abort);
    return exit;
  } catch (const client::ClientError& error) {
    return exit_for(error);
  } catch (const std::exception& error) {
    std::cerr << "saltus-worker: " << error.what() << std::endl;
    return memory_is_used_up() ? OutOfMemoryExit : InternalError;
  }
}

}  // namespace saltus::worker
