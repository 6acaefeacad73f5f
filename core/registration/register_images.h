#pragma once

#include "core/grid/volume.h"
#include "core/registration/checkpoint.h"
#include "core/registration/options.h"
#include "core/registration/progress.h"
#include "core/registration/result.h"

#include <optional>

namespace saltus {

template <int Dim>
struct RegistrationInput {
  Volume<Dim> fixed;
  Volume<Dim> moving;
  std::optional<Volume<Dim>> fixed_mask;   ///< on the fixed grid; what is 0 contributes nothing
  std::optional<Volume<Dim>> moving_mask;  ///< on the moving grid
  AffineMap<Dim> start;                    ///< fixed world -> moving world, before the deformation
  /// Model directional: unit vectors (or 0: nothing slides) on the fixed grid, world (LPS), normal to what may slide.
  std::optional<VectorVolume<Dim>> direction;
  std::vector<Vector<Dim>> fixed_points;  ///< world mm; carried along, no part of the energy
};

/// Registers `moving` to `fixed`. Throws InvalidInput before any work when input or options cannot be used,
/// NumericalFailure when no finite energy exists at the start. Not converging is a result, see the summary.
/// A run that the callback stops returns what it has, with termination Stopped. A checkpoint that `checkpointing`
/// offers takes the run up again: with the same images and options its end is the same, bit by bit. Throws InvalidInput
/// for a checkpoint that is damaged or of another job.
template <int Dim>
RegistrationResult<Dim> register_images(const RegistrationInput<Dim>& input, const RegistrationOptions& options,
                                        const ProgressCallback& progress = {}, const Checkpointing& checkpointing = {});

/// Upper bound of the memory that register_images will use, in bytes, for admission before a run: with one checkpoint
/// at a time.
template <int Dim>
std::size_t memory_estimate(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving,
                            const RegistrationOptions& options);

}  // namespace saltus
