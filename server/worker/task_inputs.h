#pragma once

#include "core/registration/register_images.h"
#include "server/worker/registration_task.h"

#include <vector>

namespace saltus::worker {

template <int Dim>
struct Landmarks {
  std::vector<Vector<Dim>> fixed, moving;  ///< world mm (LPS), as many of one as of the other
};

/// What register_images and the report want, read and checked.
template <int Dim>
struct TaskInputs {
  RegistrationInput<Dim> images;
  Landmarks<Dim> landmarks;
};

/// 2 or 3. Throws TaskFailure: INPUT_UNREADABLE, or GEOMETRY_MISMATCH when the images differ in it.
int input_dimension(const RegistrationTask& task);

/// Reads images, masks and landmarks, checks that they belong together and are finite, clips and crops.
/// Masks may be off their image's grid by a hundredth of a voxel, which formats lose by rounding; they then get that
/// grid. Throws TaskFailure: INPUT_UNREADABLE, GEOMETRY_MISMATCH, NON_FINITE_INPUT or INVALID_OPTIONS.
template <int Dim>
TaskInputs<Dim> read_inputs(const RegistrationTask& task);

/// The options that the task names. Throws InvalidInput.
RegistrationOptions make_options(const RegistrationTask& task);

}  // namespace saltus::worker
