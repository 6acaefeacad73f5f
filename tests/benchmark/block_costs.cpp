#include "tests/benchmark/block_costs.h"

#include <algorithm>
#include <cmath>
#include <ostream>

#include "core/registration/matching_objective.h"
#include "core/registration/scales.h"
#include "core/support/random.h"
#include "core/support/stopwatch.h"

namespace saltus::benchmark {
namespace {

MatchingLevel<3, float> level_of(int size) {
  MatchingLevel<3, float> level;
  level.lattice = {{size, size, size}, {1, 1, 1}, {}};
  const std::size_t sites = level.lattice.sites();
  const auto wave = [&](std::size_t i, double shift) {
    const double x = static_cast<double>(i % size), y = static_cast<double>(i / size % size),
                 z = static_cast<double>(i / size / size);
    return static_cast<float>(0.5 + 0.2 * std::sin(0.31 * (x + shift)) * std::cos(0.23 * y) + 0.2 * std::sin(0.17 * z));
  };
  level.fixed.resize(sites);
  level.moving.lattice = level.lattice;
  level.moving.samples.resize(sites);
  for (std::size_t i = 0; i < sites; ++i) {
    level.fixed[i] = wave(i, 0);
    level.moving.samples[i] = wave(i, 1.5);
  }
  level.moving.linear.setIdentity();
  level.moving.offset.setZero();
  level.similarity_weight = 1000;
  level.divergence_weight = 1;
  level.time_steps = 4;
  level.evolution = Evolution::Carried;
  return level;
}

/// Blocks of a lattice as big as the level's for which `is_in(centre, number)` holds.
template <class IsIn>
std::vector<std::uint32_t> blocks_where(const Lattice<3>& lattice, IsIn&& is_in) {
  const auto mask = BlockMask<3>::none(lattice);
  std::vector<std::uint32_t> active;
  std::uint32_t number = 0;
  for (int z = 0; z < mask.blocks()[2]; ++z)
    for (int y = 0; y < mask.blocks()[1]; ++y)
      for (int x = 0; x < mask.blocks()[0]; ++x, ++number) {
        std::array<double, 3> centre;
        const Index<3> at = {x, y, z};
        for (int axis = 0; axis < 3; ++axis) centre[axis] = (at[axis] + 0.5) * kBlockEdge / lattice.size[axis] - 0.5;
        if (is_in(centre, number)) active.push_back(number);
      }
  return active;
}

struct Choice {
  const char* name;
  std::vector<std::uint32_t> active;
};

std::vector<Choice> choices(const Lattice<3>& lattice) {
  const auto radius = [](const std::array<double, 3>& p) { return std::hypot(p[0], p[1], p[2]); };
  const double block = static_cast<double>(kBlockEdge) / lattice.size[0];
  return {{"nothing", {}},
          {"a few", blocks_where(lattice, [](const auto&, std::uint32_t n) { return n % 199 == 0; })},
          {"around a sphere",
           blocks_where(lattice, [&](const auto& p, std::uint32_t) { return std::abs(radius(p) - 0.3) < block; })},
          {"half", blocks_where(lattice, [](const auto& p, std::uint32_t) { return p[2] < 0; })},
          {"all", blocks_where(lattice, [](const auto&, std::uint32_t) { return true; })}};
}

double median_cpu_ms(MatchingObjective<3, float>& objective, int rounds) {
  std::vector<float> x(objective.size()), gradient(x.size()), preconditioned(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] = static_cast<float>(1e-3 * normal_random(7, {static_cast<std::int64_t>(i)}));
  std::vector<double> times;
  for (int round = 0; round <= rounds; ++round) {
    const Stopwatch clock;
    objective.evaluate(x, gradient, preconditioned);
    if (round > 0) times.push_back(1e3 * clock.cpu_seconds());
  }
  std::nth_element(times.begin(), times.begin() + rounds / 2, times.end());
  return times[static_cast<std::size_t>(rounds / 2)];
}

}  // namespace

std::vector<Row> block_cost_rows(bool is_quick, std::ostream& progress) {
  const MatchingLevel<3, float> level = level_of(is_quick ? 32 : 96);
  const int rounds = is_quick ? 3 : 5;
  std::vector<Row> rows;
  for (const bool own_lattice : {false, true}) {
    MomentumScale<3, float> zeroth({make_gaussian_profile(own_lattice ? 12 : 6),
                                    own_lattice ? coarsened(level.lattice, 2.0) : level.lattice, Orders::Zeroth, 100,
                                    1});
    MomentumScale<3, float> first({make_wendland_profile(6), level.lattice, Orders::First, 1, 1000});
    const auto similarity = [&] { return make_similarity<3, float>(SimilarityType::Ssd, level.lattice, {}, 1.0); };
    MatchingObjective<3, float> smooth({&zeroth}, level, similarity(), 0);
    MatchingObjective<3, float> both({&zeroth, &first}, level, similarity(), 0.01);
    const std::string place = own_lattice ? "first orders on a lattice of their own" : "on that of order 0";
    const double alone = median_cpu_ms(smooth, rounds);
    rows.push_back({place + ": order 0 alone", "", {}, {{"cpu", alone}, {"ratio", 1.0}}});
    for (const Choice& choice : choices(level.lattice))
      for (const bool looks : {false, true}) {
        progress << place << ", " << choice.name << '\n';
        both.working_set().set_active_blocks({choice.active, choice.active, choice.active});
        both.look_everywhere(looks);
        const double cpu = median_cpu_ms(both, rounds);
        rows.push_back(
            {place + ": " + choice.name + (looks ? ", a look" : ""),
             "",
             {},
             {{"active", 100 * both.working_set().active_block_share()}, {"cpu", cpu}, {"ratio", cpu / alone}}});
      }
  }
  return rows;
}

std::vector<Column> block_cost_columns() {
  return {{"active", "active blocks, %", 1}, {"cpu", "CPU ms an evaluation", 0}, {"ratio", "to order 0 alone", 2}};
}

}  // namespace saltus::benchmark
