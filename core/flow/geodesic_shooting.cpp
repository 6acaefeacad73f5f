#include "core/flow/geodesic_shooting.h"

#include "core/flow/particle_steps.h"
#include "core/support/reduction.h"

#include <algorithm>

namespace saltus {
namespace {

template <class T>
const T* pointer(const Field<T>& field) {
  return field.empty() ? nullptr : field.data();
}

template <class T>
void add_fields(std::size_t count, const T* terms, T* sum) {
#pragma omp parallel for simd schedule(static)
  for (std::size_t i = 0; i < count; ++i) sum[i] += terms[i];
}

template <int Dim>
AxisBlocks<Dim> blocks_of(const std::vector<AxisBlocks<Dim>>& blocks, std::size_t scale) {
  return blocks.empty() ? AxisBlocks<Dim>{} : blocks[scale];
}

}  // namespace

template <int Dim, class T>
GeodesicShooting<Dim, T>::GeodesicShooting(std::vector<MomentumScale<Dim, T>*> scales,
                                           const Lattice<Dim>& velocity_lattice, int time_steps, Evolution evolution)
    : lattice_(velocity_lattice), time_steps_(time_steps) {
  for (MomentumScale<Dim, T>* scale : scales) {
    ScaleState state;
    state.scale = scale;
    state.transport = std::make_unique<CoadjointTransport<Dim, T>>(scale->lattice(), scale->first_order_unit(),
                                                                   has_zeroth(scale->options().orders),
                                                                   scale->has_first_order(), evolution);
    state.prolongation = std::make_unique<LatticeInterpolation<Dim, T>>(scale->lattice(), velocity_lattice, Dim);
    state.position.resize(time_steps);
    state.predicted.resize(time_steps + 1);
    for (int k = 1; k <= time_steps; ++k) {
      if (k < time_steps) state.position[k].resize(scale->field_size());
      state.predicted[k].resize(scale->field_size());
    }
    state.zeroth.resize(scale->field_size());
    if (scale->has_first_order()) state.first.resize(Dim * scale->field_size());
    state.velocity.resize(scale->field_size());
    states_.push_back(std::move(state));
  }
  velocities_.assign(time_steps + 1, Field<T>(Dim * velocity_lattice.sites()));
}

template <int Dim, class T>
void GeodesicShooting<Dim, T>::add_velocity(ScaleState& state, const T* zeroth, const T* first,
                                            const AxisFlags<Dim>& axes, Field<T>& velocity) {
  state.scale->synthesise(zeroth, first, state.velocity.data(), axes);
  state.prolongation->add_to(state.velocity.data(), velocity.data());
}

template <int Dim, class T>
void GeodesicShooting<Dim, T>::transported(ScaleState& state, const MomentumPointers<T>& momenta,
                                           const AxisBlocks<Dim>& blocks, int node) {
  state.transport->push(state.predicted[node].data(), momenta.zeroth, momenta.first, state.zeroth.data(),
                        state.first.empty() ? nullptr : state.first.data(), blocks);
}

template <int Dim, class T>
void GeodesicShooting<Dim, T>::shoot(const std::vector<MomentumPointers<T>>& momenta,
                                     const std::vector<AxisBlocks<Dim>>& blocks) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  for (Field<T>& velocity : velocities_) std::fill(velocity.begin(), velocity.end(), T(0));
  for (std::size_t s = 0; s < states_.size(); ++s)
    add_velocity(states_[s], momenta[s].zeroth, momenta[s].first, axes_with_blocks<Dim>(blocks_of<Dim>(blocks, s)),
                 velocities_[0]);

  for (int k = 0; k < time_steps_; ++k) {
    for (ScaleState& state : states_)
      advance<Dim, T>(state.scale->lattice(), pointer(state.position[k]), pointer(state.position[k]), lattice_,
                      velocities_[k].data(), dt, state.predicted[k + 1].data());
    for (std::size_t s = 0; s < states_.size(); ++s) {
      if (poll_) poll_();
      ScaleState& state = states_[s];
      const AxisBlocks<Dim> start = blocks_of<Dim>(blocks, s);
      transported(state, momenta[s], start, k + 1);
      add_velocity(state, state.zeroth.data(), pointer(state.first),
                   state.transport->reached_axes(axes_with_blocks<Dim>(start)), velocities_[k + 1]);
    }
    if (k + 1 == time_steps_) break;
    for (ScaleState& state : states_) {
      const Lattice<Dim>& sites = state.scale->lattice();
      T* next = state.position[k + 1].data();
      advance<Dim, T>(sites, pointer(state.position[k]), pointer(state.position[k]), lattice_, velocities_[k].data(),
                      dt / 2, next);
      advance<Dim, T>(sites, next, state.predicted[k + 1].data(), lattice_, velocities_[k + 1].data(), dt / 2, next);
    }
  }
}

template <int Dim, class T>
std::vector<double> GeodesicShooting<Dim, T>::hamiltonians(const std::vector<MomentumPointers<T>>& momenta) {
  std::vector<double> energies(time_steps_ + 1, 0.0);
  for (std::size_t s = 0; s < states_.size(); ++s) {
    ScaleState& state = states_[s];
    energies[0] += state.scale->total_energy(momenta[s].zeroth, momenta[s].first);
    for (int k = 1; k <= time_steps_; ++k) {
      transported(state, momenta[s], {}, k);
      energies[k] += state.scale->total_energy(state.zeroth.data(), pointer(state.first));
    }
  }
  return energies;
}

template <int Dim, class T>
void GeodesicShooting<Dim, T>::adjoint(const std::vector<MomentumPointers<T>>& momenta,
                                       std::vector<Field<T>>& velocity_duals,
                                       const std::vector<MomentumTargets<T>>& gradient,
                                       const std::vector<MomentumTargets<T>>& preconditioned,
                                       const std::vector<AxisBlocks<Dim>>& blocks) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  std::vector<Field<T>> position_dual(states_.size()), predicted_dual(states_.size());
  for (std::size_t s = 0; s < states_.size(); ++s) {
    position_dual[s].assign(states_[s].scale->field_size(), T(0));
    predicted_dual[s].assign(states_[s].scale->field_size(), T(0));
  }
  Field<T> restricted, zeroth_dual, first_dual;

  for (int k = time_steps_; k >= 0; --k) {
    // Corrector X_k = X_{k-1} + dt/2 (v_{k-1}(X_{k-1}) + v_k(predicted_k)): the part that needs v_k. No X_N exists.
    for (std::size_t s = 0; s < states_.size() && k > 0; ++s) {
      ScaleState& state = states_[s];
      std::fill(predicted_dual[s].begin(), predicted_dual[s].end(), T(0));
      if (k < time_steps_)
        advance_adjoint<Dim, T>(state.scale->lattice(), state.predicted[k].data(), lattice_, velocities_[k].data(),
                                dt / 2, position_dual[s].data(), plan_, velocity_duals[k].data(),
                                predicted_dual[s].data());
    }
    // v_k is used nowhere else: its dual is complete.
    for (std::size_t s = 0; s < states_.size(); ++s) {
      if (poll_) poll_();
      ScaleState& state = states_[s];
      const bool first_order = state.scale->has_first_order();
      const double per_volume = 1 / state.scale->lattice().cell_volume();
      restricted.resize(state.scale->field_size());
      zeroth_dual.resize(state.scale->field_size());
      first_dual.resize(first_order ? Dim * state.scale->field_size() : 0);
      state.prolongation->transpose(velocity_duals[k].data(), restricted.data());
      const AxisBlocks<Dim> start = blocks_of<Dim>(blocks, s);
      const AxisFlags<Dim> axes = axes_with_blocks<Dim>(start);
      state.scale->synthesise_transpose(restricted.data(), zeroth_dual.data(),
                                        first_order ? first_dual.data() : nullptr,
                                        k == 0 ? axes : state.transport->reached_axes(axes));
      if (k == 0) {
        const std::size_t field = state.scale->field_size();
        if (gradient[s].zeroth) add_fields(field, zeroth_dual.data(), gradient[s].zeroth);
        for (std::size_t axis = 0; first_order && axis < Dim; ++axis)
          if (axes[axis]) add_fields(field, first_dual.data() + axis * field, gradient[s].first + axis * field);
        if (T* sum = preconditioned[s].zeroth) {
          const std::size_t count = restricted.size();
#pragma omp parallel for simd schedule(static)
          for (std::size_t i = 0; i < count; ++i) sum[i] += static_cast<T>(per_volume) * restricted[i];
        }
        continue;
      }
      state.transport->push_adjoint(state.predicted[k].data(), momenta[s].zeroth, momenta[s].first, zeroth_dual.data(),
                                    first_order ? first_dual.data() : nullptr, predicted_dual[s].data(),
                                    gradient[s].zeroth, gradient[s].first, start);
      if (preconditioned[s].zeroth)
        state.transport->pull_back(state.predicted[k].data(), restricted.data(), static_cast<T>(per_volume),
                                   preconditioned[s].zeroth);
    }
    if (k == 0) break;
    // What X_{k-1} and v_{k-1}(X_{k-1}) receive from corrector and predictor.
    for (std::size_t s = 0; s < states_.size(); ++s) {
      ScaleState& state = states_[s];
      Field<T>& through_velocity = zeroth_dual;
      through_velocity.resize(state.scale->field_size());
      const std::size_t count = state.scale->field_size();
#pragma omp parallel for simd schedule(static)
      for (std::size_t i = 0; i < count; ++i) {
        through_velocity[i] = position_dual[s][i] / 2 + predicted_dual[s][i];
        position_dual[s][i] += predicted_dual[s][i];
      }
      advance_adjoint<Dim, T>(state.scale->lattice(), pointer(state.position[k - 1]), lattice_,
                              velocities_[k - 1].data(), dt, through_velocity.data(), plan_,
                              velocity_duals[k - 1].data(), position_dual[s].data());
    }
  }
}

template class GeodesicShooting<2, float>;
template class GeodesicShooting<3, float>;
template class GeodesicShooting<2, double>;
template class GeodesicShooting<3, double>;

}  // namespace saltus
