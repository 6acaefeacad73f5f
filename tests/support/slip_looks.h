#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <vector>

#include "core/evaluation/field_error.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"

namespace saltus::testing {

// Slips that order 0 is asked for, and what a run tells of the level on which it was.

constexpr int kLooksAfter = 3;  ///< iterations of a level, where a slip may be plain

template <int Dim>
Phantom<Dim> phantom(PhantomKind kind, double angle_deg = 0) {  // 3-D: of 32^3 voxels on the finest level
  PhantomOptions scene = default_phantom_options(kind, Dim);
  scene.size = Dim == 2 ? std::array<int, 3>{96, 96, 1} : std::array<int, 3>{64, 64, 64};
  scene.noise = 0.01;
  scene.angle_deg = angle_deg;
  if (kind == PhantomKind::Smooth) scene.displacement_mm = 4;
  return make_phantom<Dim>(scene);
}

/// Of the level that was asked, in its first round.
inline int first_iterations(const RegistrationSummary& summary, const LevelSummary& level) {
  return static_cast<int>(std::count_if(summary.history.begin(), summary.history.end(), [&](const IterationRecord& at) {
    return at.level == level.level && at.round == 1;
  }));
}

inline const LevelSummary& asked(const RegistrationSummary& summary) {
  const auto found = std::find_if(summary.levels.begin(), summary.levels.end(),
                                  [](const LevelSummary& level) { return level.decision != FirstOrderDecision::None; });
  if (found == summary.levels.end()) throw std::logic_error("no level was asked");
  return *found;
}

inline int evaluations(const RegistrationSummary& summary) {
  int sum = 0;
  for (const LevelSummary& level : summary.levels) sum += level.evaluations;
  return sum;
}

/// Of that round: before it, and after each of its iterations.
inline std::vector<double> first_energies(const RegistrationSummary& summary, const LevelSummary& level) {
  std::vector<double> energies{level.energy_before};
  for (const IterationRecord& at : summary.history)
    if (at.level == level.level && at.round == 1) energies.push_back(at.energy);
  return energies;
}

/// Over registrations whose truth is known.
struct Sums {
  double error_mm = 0, error_near_mm = 0;
  int evaluations = 0;
};

template <int Dim>
void add(const RegistrationResult<Dim>& found, const Phantom<Dim>& slip, Sums& sums) {
  sums.evaluations += evaluations(found.summary);
  for (double at : endpoint_errors<Dim>(found.displacement, slip.displacement, slip.masks.valid)) sums.error_mm += at;
  for (double at : endpoint_errors<Dim>(found.displacement, slip.displacement, slip.masks.near))
    sums.error_near_mm += at;
}

inline Phantom<3> body_that_slides(double radius_mm, double slip_mm) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip, 3);
  scene.size = {64, 64, 64};
  scene.noise = 0.02;
  scene.interface = InterfaceShape::Circle;
  scene.radius_mm = radius_mm;
  scene.slip_mm = slip_mm;
  return make_phantom<3>(scene);
}

}  // namespace saltus::testing
