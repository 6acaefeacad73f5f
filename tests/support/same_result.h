#pragma once

#include <gtest/gtest.h>

#include "core/registration/result.h"

namespace saltus::testing {

/// Fields, momenta and the course of the optimisation, bit by bit; times are not compared.
template <int Dim>
void expect_same_bits(const RegistrationResult<Dim>& a, const RegistrationResult<Dim>& b) {
  EXPECT_EQ(a.displacement.samples, b.displacement.samples);
  EXPECT_EQ(a.inverse_displacement.samples, b.inverse_displacement.samples);
  EXPECT_EQ(a.warped.samples, b.warped.samples);
  EXPECT_EQ(a.jacobian.samples, b.jacobian.samples);
  ASSERT_EQ(a.momenta.size(), b.momenta.size());
  for (std::size_t k = 0; k < a.momenta.size(); ++k)
    EXPECT_EQ(a.momenta[k].vectors.samples, b.momenta[k].vectors.samples);
  ASSERT_EQ(a.summary.history.size(), b.summary.history.size());
  for (std::size_t k = 0; k < a.summary.history.size(); ++k) {
    const IterationRecord &one = a.summary.history[k], &other = b.summary.history[k];
    EXPECT_EQ(one.level, other.level);
    EXPECT_EQ(one.round, other.round);
    EXPECT_EQ(one.iteration, other.iteration);
    EXPECT_EQ(one.energy, other.energy);
    EXPECT_EQ(one.similarity, other.similarity);
    EXPECT_EQ(one.regularisation, other.regularisation);
    EXPECT_EQ(one.sparsity, other.sparsity);
    EXPECT_EQ(one.step, other.step);
    EXPECT_EQ(one.optimality, other.optimality);
  }
  ASSERT_EQ(a.summary.levels.size(), b.summary.levels.size());
  for (std::size_t k = 0; k < a.summary.levels.size(); ++k) {
    const LevelSummary &one = a.summary.levels[k], &other = b.summary.levels[k];
    EXPECT_EQ(one.level, other.level);
    EXPECT_EQ(one.grid, other.grid);
    EXPECT_EQ(one.spacing_mm, other.spacing_mm);
    EXPECT_EQ(one.iterations, other.iterations);
    EXPECT_EQ(one.evaluations, other.evaluations);
    EXPECT_EQ(one.rounds, other.rounds);
    EXPECT_EQ(one.optimality, other.optimality);
    EXPECT_EQ(one.smoothing_voxels, other.smoothing_voxels);
    EXPECT_EQ(one.similarity_weight, other.similarity_weight);
    EXPECT_EQ(one.energy_before, other.energy_before);
    EXPECT_EQ(one.energy_after, other.energy_after);
    EXPECT_EQ(one.termination, other.termination);
    EXPECT_EQ(one.active_block_share, other.active_block_share);
    EXPECT_EQ(one.kept_out_share, other.kept_out_share);
    EXPECT_EQ(one.decision, other.decision);
    EXPECT_EQ(one.simple_shear, other.simple_shear);
    EXPECT_EQ(one.oriented_elements, other.oriented_elements);
    EXPECT_EQ(one.has_finer, other.has_finer);
    EXPECT_EQ(one.shear_before, other.shear_before);
    EXPECT_EQ(one.narrow_share, other.narrow_share);
    EXPECT_EQ(one.narrow_pull, other.narrow_pull);
    EXPECT_EQ(one.own_pull, other.own_pull);
    EXPECT_EQ(one.has_narrower, other.has_narrower);
    EXPECT_EQ(one.map_steps, other.map_steps);
    EXPECT_EQ(one.map_error_mm, other.map_error_mm);
  }
  EXPECT_EQ(a.summary.termination, b.summary.termination);
  EXPECT_EQ(a.summary.similarity_after, b.summary.similarity_after);
}

}  // namespace saltus::testing
