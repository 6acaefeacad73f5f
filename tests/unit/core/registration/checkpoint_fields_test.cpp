// Every field of a checkpoint survives being stored, whether or not a short run would miss it. The bindings below name
// all of them: one that is added does not compile until it is filled and compared here.
#include "core/registration/checkpoint.h"

#include <gtest/gtest.h>

#include <deque>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "tests/support/checkpoint_bytes.h"

namespace saltus {
namespace {

/// Values of which no two are the same.
class Numbers {
 public:
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(T& value) { value = static_cast<T>(++last_) + static_cast<T>(0.5); }
  void operator()(ShortFloat& value) { value = ShortFloat(static_cast<float>(++last_)); }  // to 256 no two are the same
  void operator()(std::string& text) { text = "text " + std::to_string(++last_); }
  void operator()(FirstOrderDecision& what) { what = FirstOrderDecision::LetIn; }
  void operator()(Termination& why) { why = Termination::IterationLimit; }
  template <class T>
  void operator()(std::vector<T>& values) {
    values.resize(3);
    for (T& value : values) (*this)(value);
  }
  void operator()(std::deque<CurvaturePair<float>>& pairs) {
    for (CurvaturePair<float>& pair : pairs = std::deque<CurvaturePair<float>>(2)) {
      auto& [s, y, y_preconditioned, rho] = pair;
      fill(s, y, y_preconditioned, rho);
    }
  }
  void operator()(IterationRecord& record) {
    auto& [level, round, iteration, energy, similarity, regularisation, sparsity, step, optimality] = record;
    fill(level, round, iteration, energy, similarity, regularisation, sparsity, step, optimality);
  }
  void operator()(LevelSummary& summary) {
    auto& [level, grid, spacing, iterations, evaluations, rounds, optimality, smoothing, weight, before, after, why,
           share, kept_out, decision, shear, has_finer, was_plain, quick, quick_after, gave_up, shear_before,
           narrow_share, narrow_pull, own_pull, has_narrower, elements, map_steps, map_error, oblique, seconds,
           cpu_seconds] = summary;
    fill(level, grid, spacing, iterations, evaluations, rounds, optimality, smoothing, weight, before, after, why,
         share, kept_out, decision, shear, has_finer, was_plain, quick, quick_after, gave_up, shear_before,
         narrow_share, narrow_pull, own_pull, has_narrower, elements, map_steps, map_error, oblique, seconds,
         cpu_seconds);
  }
  void operator()(MinimiserState<float>& state) {
    auto& [x, gradient, preconditioned, pairs, energies, first_optimality, noise, evaluations, looked_at, look_gap,
           revised_at, settled_at] = state;
    fill(x, gradient, preconditioned, pairs, energies, first_optimality, noise, evaluations, looked_at, look_gap,
         revised_at, settled_at);
  }
  void operator()(Checkpoint& checkpoint) {
    auto& [step, level, start, reference, factors, blocks, elements, normals, turned, minimiser, levels, history,
           seconds, cpu_seconds] = checkpoint;
    fill(step, level, start, reference, factors, blocks, elements, normals, turned, minimiser, levels, history, seconds,
         cpu_seconds);
  }

 private:
  template <class... T>
  void fill(T&... values) {
    ((*this)(values), ...);
  }
  int last_ = 0;
};

void expect_same(const LevelSummary& one, const LevelSummary& other, const char* what) {
  EXPECT_EQ(std::tie(one.level, one.grid, one.spacing_mm, one.iterations, one.evaluations, one.rounds, one.optimality,
                     one.smoothing_voxels),
            std::tie(other.level, other.grid, other.spacing_mm, other.iterations, other.evaluations, other.rounds,
                     other.optimality, other.smoothing_voxels))
      << what;
  EXPECT_EQ(
      std::tie(one.similarity_weight, one.energy_before, one.energy_after, one.termination, one.active_block_share,
               one.kept_out_share, one.decision, one.simple_shear, one.has_finer, one.was_plain, one.quick_share,
               one.quick_after, one.gave_up_sharp, one.shear_before, one.narrow_share, one.narrow_pull, one.own_pull,
               one.has_narrower, one.oriented_elements, one.map_steps, one.map_error_mm, one.oblique_share, one.seconds,
               one.cpu_seconds),
      std::tie(other.similarity_weight, other.energy_before, other.energy_after, other.termination,
               other.active_block_share, other.kept_out_share, other.decision, other.simple_shear, other.has_finer,
               other.was_plain, other.quick_share, other.quick_after, other.gave_up_sharp, other.shear_before,
               other.narrow_share, other.narrow_pull, other.own_pull, other.has_narrower, other.oriented_elements,
               other.map_steps, other.map_error_mm, other.oblique_share, other.seconds, other.cpu_seconds))
      << what;
}

TEST(CheckpointFields, AllSurviveBeingStored) {
  Checkpoint stored;
  Numbers()(stored);
  const Checkpoint read = decoded(encoded(stored, 7), 7);
  EXPECT_EQ(read.step, stored.step);
  expect_same(read.level, stored.level, "level");
  EXPECT_EQ(read.level_start, stored.level_start);
  EXPECT_EQ(read.optimality_reference, stored.optimality_reference);
  EXPECT_EQ(read.sparsity_factors, stored.sparsity_factors);
  EXPECT_EQ(read.active_blocks, stored.active_blocks);
  EXPECT_EQ(read.active_elements, stored.active_elements);
  EXPECT_EQ(read.turned_normals, stored.turned_normals);
  EXPECT_EQ(read.turned_elements, stored.turned_elements);
  EXPECT_EQ(read.seconds, stored.seconds);
  EXPECT_EQ(read.cpu_seconds, stored.cpu_seconds);

  const MinimiserState<float>&a = read.minimiser, &b = stored.minimiser;
  EXPECT_EQ(a.x, b.x);
  EXPECT_EQ(a.gradient, b.gradient);
  EXPECT_EQ(a.preconditioned, b.preconditioned);
  EXPECT_EQ(a.energies, b.energies);
  EXPECT_EQ(a.first_optimality, b.first_optimality);
  EXPECT_EQ(a.noise_optimality, b.noise_optimality);
  EXPECT_EQ(a.evaluations, b.evaluations);
  EXPECT_EQ(a.looked_at, b.looked_at);
  EXPECT_EQ(a.look_gap, b.look_gap);
  EXPECT_EQ(a.revised_at, b.revised_at);
  EXPECT_EQ(a.settled_at, b.settled_at);
  ASSERT_EQ(a.pairs.size(), b.pairs.size());
  for (std::size_t k = 0; k < a.pairs.size(); ++k) {
    EXPECT_EQ(a.pairs[k].s, b.pairs[k].s);
    EXPECT_EQ(a.pairs[k].y, b.pairs[k].y);
    EXPECT_EQ(a.pairs[k].y_preconditioned, b.pairs[k].y_preconditioned);
    EXPECT_EQ(a.pairs[k].rho, b.pairs[k].rho);
  }
  ASSERT_EQ(read.levels.size(), stored.levels.size());
  for (std::size_t k = 0; k < read.levels.size(); ++k) expect_same(read.levels[k], stored.levels[k], "ended level");
  ASSERT_EQ(read.history.size(), stored.history.size());
  for (std::size_t k = 0; k < read.history.size(); ++k) {
    const IterationRecord &one = read.history[k], &other = stored.history[k];
    EXPECT_EQ(std::tie(one.level, one.round, one.iteration, one.energy, one.similarity, one.regularisation,
                       one.sparsity, one.step, one.optimality),
              std::tie(other.level, other.round, other.iteration, other.energy, other.similarity, other.regularisation,
                       other.sparsity, other.step, other.optimality));
  }
}

}  // namespace
}  // namespace saltus
