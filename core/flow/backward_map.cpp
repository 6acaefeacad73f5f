#include "core/flow/backward_map.h"

#include "core/flow/particle_steps.h"
#include "core/support/ranking.h"

#include <algorithm>
#include <array>

namespace saltus {

template <int Dim, class T>
BackwardMap<Dim, T>::BackwardMap(const Lattice<Dim>& points, const Lattice<Dim>& velocity_lattice, int time_steps)
    : points_(points), lattice_(velocity_lattice), time_steps_(time_steps), position_(time_steps + 1) {
  for (int k = 0; k < time_steps; ++k) position_[k].resize(Dim * points.sites());
}

template <int Dim, class T>
const Field<T>& BackwardMap<Dim, T>::follow(const std::vector<Field<T>>& velocities) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  for (int k = time_steps_ - 1; k >= 0; --k) {
    const T* from = position_[k + 1].empty() ? nullptr : position_[k + 1].data();
    advance_heun<Dim, T>(points_, from, lattice_, velocities[k + 1].data(), velocities[k].data(), -dt,
                         position_[k].data());
  }
  return position_[0];
}

template <int Dim, class T>
void BackwardMap<Dim, T>::adjoint(const std::vector<Field<T>>& velocities, Field<T>& dual,
                                  std::vector<Field<T>>& velocity_duals) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  for (int k = 0; k < time_steps_; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const T* from = position_[at + 1].empty() ? nullptr : position_[at + 1].data();
    // The map itself is not needed any more; its place takes the dual of the position at node k + 1.
    advance_heun_adjoint<Dim, T>(points_, from, lattice_, velocities[at + 1].data(), velocities[at].data(), -dt,
                                 dual.data(), velocity_duals[at + 1].data(), velocity_duals[at].data(),
                                 from ? position_[0].data() : nullptr);
    if (from) dual.swap(position_[0]);
  }
}

template <int Dim, class T>
Field<T> backward_map(const Lattice<Dim>& points, const Lattice<Dim>& lattice,
                      const std::vector<Field<T>>& velocities) {
  const int time_steps = static_cast<int>(velocities.size()) - 1;
  Field<T> moved(Dim * points.sites());
  for (int k = time_steps - 1; k >= 0; --k)
    advance_heun<Dim, T>(points, k + 1 < time_steps ? moved.data() : nullptr, lattice, velocities[k + 1].data(),
                         velocities[k].data(), -T(1) / static_cast<T>(time_steps), moved.data());
  return moved;
}

template <int Dim, class T>
double map_error(const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities) {
  const int steps = static_cast<int>(velocities.size()) - 1;
  const Field<T> coarse = backward_map<Dim, T>(lattice, lattice, velocities);
  Field<T> fine(coarse.size()), between(coarse.size());
  const T half_step = -T(1) / static_cast<T>(2 * steps);
  for (int k = steps - 1; k >= 0; --k) {
    const auto at = static_cast<std::size_t>(k);
#pragma omp parallel for simd schedule(static)
    for (std::size_t i = 0; i < between.size(); ++i) between[i] = (velocities[at][i] + velocities[at + 1][i]) / 2;
    advance_heun<Dim, T>(lattice, k + 1 < steps ? fine.data() : nullptr, lattice, velocities[at + 1].data(),
                         between.data(), half_step, fine.data());
    advance_heun<Dim, T>(lattice, fine.data(), lattice, between.data(), velocities[at].data(), half_step, fine.data());
  }
  std::vector<T> squares(lattice.sites());
#pragma omp parallel for schedule(static)
  for (std::size_t site = 0; site < squares.size(); ++site) {
    T sum = 0;
    for (int c = 0; c < Dim; ++c) {
      const T off = coarse[Dim * site + c] - fine[Dim * site + c];
      sum += off * off;
    }
    squares[site] = sum;
  }
  const auto rank = static_cast<std::size_t>(0.999 * static_cast<double>(squares.size() - 1));
  return 4.0 / 3 * std::sqrt(static_cast<double>(ranking_of(squares.size(), squares.data()).at(rank)));
}

namespace {

/// v of a node at a point of the frame.
template <int Dim, class T>
Vector<Dim> sampled(const Lattice<Dim>& lattice, const Field<T>& velocity, const Vector<Dim>& at) {
  std::array<T, Dim> coordinates;
  for (int c = 0; c < Dim; ++c) coordinates[c] = static_cast<T>((at[c] - lattice.offset[c]) / lattice.spacing[c]);
  const auto value = LinearCell<Dim, T>(lattice, coordinates).template value<Dim>(velocity.data());
  Vector<Dim> vector;
  for (int c = 0; c < Dim; ++c) vector[c] = value[c];
  return vector;
}

template <int Dim, class T>
Vector<Dim> heun_step(const Lattice<Dim>& lattice, const Field<T>& first, const Field<T>& second, double step,
                      const Vector<Dim>& at) {
  const Vector<Dim> v = sampled<Dim, T>(lattice, first, at);
  return at + 0.5 * step * (v + sampled<Dim, T>(lattice, second, at + step * v));
}

}  // namespace

template <int Dim, class T>
Vector<Dim> forward_guess(const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities,
                          const Vector<Dim>& start) {
  const int time_steps = static_cast<int>(velocities.size()) - 1;
  Vector<Dim> position = start;
  for (int k = 0; k < time_steps; ++k)
    position = heun_step<Dim, T>(lattice, velocities[k], velocities[k + 1], 1.0 / time_steps, position);
  return position;
}

template <int Dim, class T>
void move_forward(const Lattice<Dim>& points, const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities,
                  Field<T>& moved) {
  const int time_steps = static_cast<int>(velocities.size()) - 1;
  for (int k = 0; k < time_steps; ++k)
    advance_heun<Dim, T>(points, moved.data(), lattice, velocities[k].data(), velocities[k + 1].data(),
                         T(1) / static_cast<T>(time_steps), moved.data());
}

template <int Dim, class T>
Vector<Dim> forward_point(const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities,
                          const Vector<Dim>& start) {
  constexpr int kMostRounds = 12;
  const int time_steps = static_cast<int>(velocities.size()) - 1;
  const double dt = 1.0 / time_steps;
  const double close = 1e-4 * *std::min_element(lattice.spacing.begin(), lattice.spacing.end());
  Vector<Dim> position = start;
  for (int k = 0; k < time_steps; ++k) {
    const auto back = [&](const Vector<Dim>& x) {
      return heun_step<Dim, T>(lattice, velocities[k + 1], velocities[k], -dt, x);
    };
    const Vector<Dim> target = position;
    position = heun_step<Dim, T>(lattice, velocities[k], velocities[k + 1], dt, target);
    Vector<Dim> missing = target - back(position), trial = position;
    for (int round = 0; round < kMostRounds && missing.norm() > close; ++round) {
      trial = position + missing;
      const Vector<Dim> left = target - back(trial);
      if (!(left.norm() < missing.norm())) break;
      position = trial;
      missing = left;
    }
  }
  return position;
}

template <int Dim, class T>
Field<T> forward_map(const Lattice<Dim>& points, const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities) {
  Field<T> moved(Dim * points.sites());
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab)
    visit_slab<Dim>(points, slab, [&](const Index<Dim>& index, std::size_t site) {
      Vector<Dim> start;
      for (int c = 0; c < Dim; ++c) start[c] = points.offset[c] + index[c] * points.spacing[c];
      const Vector<Dim> end = forward_point<Dim, T>(lattice, velocities, start);
      for (int c = 0; c < Dim; ++c) moved[Dim * site + c] = static_cast<T>(end[c] - start[c]);
    });
  return moved;
}

template class BackwardMap<2, float>;
template class BackwardMap<3, float>;
template class BackwardMap<2, double>;
template class BackwardMap<3, double>;
#define SALTUS_FORWARD(DIM, T)                                                                                       \
  template Vector<DIM> forward_guess<DIM, T>(const Lattice<DIM>&, const std::vector<Field<T>>&, const Vector<DIM>&); \
  template Vector<DIM> forward_point<DIM, T>(const Lattice<DIM>&, const std::vector<Field<T>>&, const Vector<DIM>&); \
  template void move_forward<DIM, T>(const Lattice<DIM>&, const Lattice<DIM>&, const std::vector<Field<T>>&,         \
                                     Field<T>&);                                                                     \
  template double map_error<DIM, T>(const Lattice<DIM>&, const std::vector<Field<T>>&);                              \
  template Field<T> backward_map<DIM, T>(const Lattice<DIM>&, const Lattice<DIM>&, const std::vector<Field<T>>&);    \
  template Field<T> forward_map<DIM, T>(const Lattice<DIM>&, const Lattice<DIM>&, const std::vector<Field<T>>&);
SALTUS_FORWARD(2, float)
SALTUS_FORWARD(3, float)
SALTUS_FORWARD(2, double)
SALTUS_FORWARD(3, double)
#undef SALTUS_FORWARD

}  // namespace saltus
