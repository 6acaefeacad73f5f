#pragma once

#include <memory>
#include <optional>
#include <string>

#include "core/phantom/make_phantom.h"
#include "core/phantom/scene.h"
#include "core/registration/register_images.h"
#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// A pair of images, and what is known of the motion between them.
template <int Dim>
struct Pair {
  RegistrationInput<Dim> input;
  std::shared_ptr<const Scene<Dim>> scene;  ///< null when there is no truth
  Phantom<Dim> truth;                       ///< of the scene; empty without one
};

template <int Dim>
Pair<Dim> pair_of(std::shared_ptr<const Scene<Dim>> scene, const ImageGrid<Dim>& grid, double noise,
                  std::uint64_t seed = 1);

template <int Dim>
Pair<Dim> pair_of(const PhantomOptions& options);

enum class Expected { Result, Refusal };

/// Registers the pair and measures. Never throws for what a registration does: a refusal is an outcome, and what must
/// not happen is a complaint: another exception, a refusal where a result is expected or the other way round, a value
/// that is not finite, an energy that rises on an accepted step.
/// `result` is filled when there is one.
template <int Dim>
Row measure(const std::string& name, const Pair<Dim>& pair, const RegistrationOptions& options,
            Expected expected = Expected::Result, std::optional<RegistrationResult<Dim>>* result = nullptr);

/// Adds to the row how far a displacement is from the scene's truth; nothing without a scene.
template <int Dim>
void add_truth(const Pair<Dim>& pair, const VectorVolume<Dim>& displacement, Row& row);

/// Largest distance of two fields on one grid, mm.
template <int Dim>
double largest_difference(const VectorVolume<Dim>& a, const VectorVolume<Dim>& b);

}  // namespace saltus::benchmark
