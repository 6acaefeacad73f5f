#pragma once

#include "core/optimisation/lbfgs.h"
#include "core/registration/progress.h"
#include "core/registration/result.h"

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <memory>

namespace saltus {

template <int Dim>
struct RegistrationInput;

/// Writes the checkpoint of the step that was just accepted, bytes to be kept as they are. Nothing of it is held in
/// memory twice. Whether the stream has taken it all is the caller's to ask.
using MakeCheckpoint = std::function<void(std::ostream&)>;

/// Opens a checkpoint to be read once. The stream has to be able to seek.
using OpenCheckpoint = std::function<std::unique_ptr<std::istream>()>;

/// Offered after each accepted step, from the thread that called register_images; `make` may be called in there only.
/// What it makes is as large as MinimiserState says.
using CheckpointCallback = std::function<void(const Progress&, const MakeCheckpoint& make)>;

/// How a registration can be interrupted and taken up again.
struct Checkpointing {
  OpenCheckpoint resume;     ///< a checkpoint of an earlier run of the same job; empty: from the beginning
  CheckpointCallback offer;  ///< may be empty
};

/// All that a run has found until an accepted step. A run that goes on from here ends with the same bits as one that
/// was never interrupted, for any number of threads.
struct Checkpoint {
  int step = 0;        ///< which of the levels that are run, 0 is the coarsest
  LevelSummary level;  ///< of that level: the rounds before this one, which is number level.rounds; its time until now
  std::vector<float> level_start;   ///< momenta that first orders begin beside; empty: where order 0 ended
  double optimality_reference = 0;  ///< of that level
  std::vector<std::vector<float>> sparsity_factors;         ///< of this round
  std::vector<std::vector<std::uint32_t>> active_blocks;    ///< that the minimiser's unknowns are of
  std::vector<std::vector<std::uint32_t>> active_elements;  ///< the same of oriented momenta
  std::vector<std::vector<float>> turned_normals;           ///< of the oriented momenta in this round, by scale
  std::vector<std::vector<std::uint32_t>> turned_elements;  ///< that have them
  MinimiserState<float> minimiser;
  std::vector<LevelSummary> levels;      ///< that have ended
  std::vector<IterationRecord> history;  ///< until now
  double seconds = 0, cpu_seconds = 0;   ///< spent in all
};

/// Tells jobs apart: images, masks, direction field, start and all options as they are asked for but the number of
/// threads.
template <int Dim>
std::uint64_t job_fingerprint(const RegistrationInput<Dim>& input, const RegistrationOptions& asked);

/// With a version, a checksum and the job's fingerprint, for machines of the same byte order.
void encode(const Checkpoint& checkpoint, std::uint64_t job, std::ostream& out);

/// Throws InvalidInput that says so when what is in the stream is none of ours, of another version, damaged, or of
/// another job.
Checkpoint decode(std::istream& in, std::uint64_t job);

}  // namespace saltus
