#include "core/flow/geodesic_shooting.h"

#include "core/flow/particle_steps.h"

#include <algorithm>
#include <stdexcept>

namespace saltus {
namespace {

template <class T>
const T* pointer(const Field<T>& field) {
  return field.empty() ? nullptr : field.data();
}
template <class T>
T* mutable_pointer(Field<T>& field) {
  return field.empty() ? nullptr : field.data();
}

/// sum += terms in the blocks of `where`.
template <int Dim, class T>
void add_fields(const Lattice<Dim>& lattice, const BlockMask<Dim>& where, const T* terms, T* sum) {
  where.for_runs(lattice, [&](std::size_t begin, std::size_t count) {
    for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) sum[i] += terms[i];
  });
}

}  // namespace

template <int Dim, class T>
GeodesicShooting<Dim, T>::SharedLattice::SharedLattice(const Lattice<Dim>& lattice,
                                                       const Lattice<Dim>& velocity_lattice)
    : lattice(lattice),
      prolongation(lattice, velocity_lattice, Dim),
      sites(lattice, Evolution::Carried),
      moved(BlockMask<Dim>::all(lattice)),
      acting(moved) {}

/// Where its sites are, and their Jacobians, once a scale has momenta at them.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::SharedLattice::make_fields(Evolution evolution) {
  if (!predicted_dual.empty()) return;
  sites = MovedSites<Dim, T>(lattice, evolution);
  const std::size_t field = Dim * lattice.sites(), steps = position.size();
  for (std::size_t k = 1; k <= steps; ++k) {
    if (k < steps) position[k].resize(field);
    predicted[k].resize(field);
  }
  predicted_dual.resize(field);
  if (steps > 1) position_dual.resize(field);
  if (prolongation.is_identity()) return;
  sum.resize(field);
  restricted.resize(field);
}

template <int Dim, class T>
GeodesicShooting<Dim, T>::GeodesicShooting(std::vector<MomentumScale<Dim, T>*> scales,
                                           const Lattice<Dim>& velocity_lattice, int time_steps, Evolution evolution,
                                           int map_steps)
    : lattice_(velocity_lattice), time_steps_(time_steps), map_steps_(map_steps) {
  for (MomentumScale<Dim, T>* scale : scales) {
    const auto found = std::find_if(lattices_.begin(), lattices_.end(),
                                    [&](const auto& shared) { return shared->lattice == scale->lattice(); });
    SharedLattice* same = found == lattices_.end() ? nullptr : found->get();
    const bool same_lattice_before = same != nullptr;
    if (!same) {
      auto shared = std::make_unique<SharedLattice>(scale->lattice(), velocity_lattice);
      shared->position.resize(time_steps);
      shared->predicted.resize(time_steps + 1);
      same = shared.get();
      lattices_.push_back(std::move(shared));
    }
    if (scale->has_fields()) same->make_fields(evolution);
    ScaleState state;
    state.scale = scale;
    state.shared = same;
    const bool zeroth = has_zeroth(scale->options().orders);
    state.shared->moves_everywhere = state.shared->moves_everywhere || zeroth;
    state.transport = std::make_unique<CoadjointTransport<Dim, T>>(scale->lattice(), scale->first_order_unit(), zeroth,
                                                                   scale->has_first_order(), evolution);
    // With `exact` first orders turn into order 0.
    if (zeroth || (scale->has_first_order() && evolution == Evolution::Exact)) state.zeroth.resize(scale->field_size());
    if (scale->has_first_order()) state.first.resize(Dim * scale->field_size());
    if (scale->has_fields() && (same_lattice_before || !zeroth)) state.velocity.resize(scale->field_size());
    if (scale->oriented())
      state.oriented =
          std::make_unique<OrientedFlow<Dim, T>>(*scale->oriented(), velocity_lattice, time_steps, evolution);
    states_.push_back(std::move(state));
  }
  velocities_.assign(nodes(), Field<T>(Dim * velocity_lattice.sites()));
}

template <int Dim, class T>
AxisBlocks<Dim> GeodesicShooting<Dim, T>::momenta_of(std::size_t scale) const {
  return blocks_.momenta.empty() ? AxisBlocks<Dim>{} : blocks_.momenta[scale];
}

template <int Dim, class T>
AxisBlocks<Dim> GeodesicShooting<Dim, T>::wanted_of(std::size_t scale) const {
  return blocks_.wanted.empty() ? AxisBlocks<Dim>{} : blocks_.wanted[scale];
}

/// Where the momenta of a scale are at time 0.
template <int Dim, class T>
MomentumMasks<Dim> GeodesicShooting<Dim, T>::at_start(std::size_t scale, const AxisBlocks<Dim>& blocks) const {
  MomentumMasks<Dim> masks = states_[scale].scale->everywhere();
  if (states_[scale].scale->has_first_order()) masks.first = masks_of<Dim>(states_[scale].scale->lattice(), blocks);
  return masks;
}

/// Faces need the sites up to two samples around them, and those need their neighbours: no more than a block away.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::choose_sites() {
  for (auto& shared : lattices_) {
    const auto& lattice = shared->lattice;
    shared->moved = shared->acting =
        shared->moves_everywhere ? BlockMask<Dim>::all(lattice) : BlockMask<Dim>::none(lattice);
    for (std::size_t s = 0; s < states_.size() && !shared->moves_everywhere; ++s) {
      if (states_[s].shared != shared.get() || !states_[s].scale->has_first_order()) continue;
      for (const BlockMask<Dim>& mask : masks_of<Dim>(lattice, momenta_of(s))) shared->acting |= mask;
      for (const BlockMask<Dim>& mask : masks_of<Dim>(lattice, wanted_of(s))) shared->moved |= mask;
    }
    shared->moved |= shared->acting;
    for (BlockMask<Dim>* mask : {&shared->acting, &shared->moved}) {
      *mask = mask->with_neighbours();
      mask->complete_if_dense();
    }
  }
}

/// Nothing is there yet: the first to come writes.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::begin_velocity() {
  is_velocity_written_ = false;
  for (auto& shared : lattices_) shared->is_sum_written = false;
}

/// Adds the velocity of one scale to that of its lattice, and tells where it stands by itself until somebody adds to
/// it.
template <int Dim, class T>
const T* GeodesicShooting<Dim, T>::add_velocity(ScaleState& state, const T* zeroth, const T* first,
                                                const MomentumMasks<Dim>& at, Field<T>& velocity) {
  if (at.is_empty()) return nullptr;
  const Lattice<Dim>& lattice = state.scale->lattice();
  const bool is_direct = state.shared->sum.empty();
  Field<T>& sum = is_direct ? velocity : state.shared->sum;
  bool& is_written = is_direct ? is_velocity_written_ : state.shared->is_sum_written;
  if (state.velocity.empty()) {
    state.scale->synthesise(zeroth, first, at, sum.data());
    is_written = true;
    return sum.data();
  }
  if (!is_written) BlockMask<Dim>::all(lattice).clear(lattice, Dim, sum.data());
  is_written = true;
  const BlockMask<Dim> reached = state.scale->synthesise(zeroth, first, at, state.velocity.data());
  add_fields<Dim, T>(lattice, reached, state.velocity.data(), sum.data());
  return state.velocity.data();
}

/// Adds oriented momenta and what the lattices have gathered.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::finish_velocity(int k, Field<T>& velocity) {
  if (!is_velocity_written_) BlockMask<Dim>::all(lattice_).clear(lattice_, Dim, velocity.data());
  for (ScaleState& state : states_)
    if (state.oriented) state.oriented->add_velocity(k, velocity.data());
  for (auto& shared : lattices_)
    if (shared->is_sum_written) shared->prolongation.add_to(shared->sum.data(), velocity.data());
}

/// v at the nodes within the steps, from those at their ends.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::fill_between_steps() {
  const std::size_t count = velocities_[0].size();
  for (int k = 0; k < time_steps_; ++k)
    for (int part = 1; part < map_steps_; ++part) {
      const T share = static_cast<T>(part) / static_cast<T>(map_steps_);
      const T* before = velocities_[end_of_step(k)].data();
      const T* after = velocities_[end_of_step(k + 1)].data();
      T* between = velocities_[end_of_step(k) + part].data();
#pragma omp parallel for simd schedule(static)
      for (std::size_t i = 0; i < count; ++i) between[i] = (1 - share) * before[i] + share * after[i];
    }
}

/// Its transpose, in place.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::gather_between_steps(std::vector<Field<T>>& velocity_duals) const {
  const std::size_t count = velocity_duals[0].size();
  for (int k = 0; k < time_steps_; ++k)
    for (int part = 1; part < map_steps_; ++part) {
      const T share = static_cast<T>(part) / static_cast<T>(map_steps_);
      const T* between = velocity_duals[end_of_step(k) + part].data();
      T* before = velocity_duals[end_of_step(k)].data();
      T* after = velocity_duals[end_of_step(k + 1)].data();
#pragma omp parallel for simd schedule(static)
      for (std::size_t i = 0; i < count; ++i) {
        before[i] += (1 - share) * between[i];
        after[i] += share * between[i];
      }
    }
}

/// Makes v(0).
template <int Dim, class T>
void GeodesicShooting<Dim, T>::start(const std::vector<MomentumPointers<T>>& momenta, const ActiveBlocks<Dim>& blocks,
                                     const StartingVelocity& on_start) {
  blocks_ = blocks;
  choose_sites();
  begin_velocity();
  for (std::size_t s = 0; s < states_.size(); ++s) {
    states_[s].reached.clear();
    const T* velocity =
        add_velocity(states_[s], momenta[s].zeroth, momenta[s].first, at_start(s, momenta_of(s)), velocities_[0]);
    if (on_start && states_[s].scale->has_fields() && !states_[s].scale->has_first_order()) on_start(s, velocity);
    if (states_[s].oriented) states_[s].oriented->begin(momenta[s].elements, momenta[s].oriented);
  }
  finish_velocity(0, velocities_[0]);
}

template <int Dim, class T>
const Field<T>& GeodesicShooting<Dim, T>::starting_velocity(const std::vector<MomentumPointers<T>>& momenta) {
  start(momenta, {}, {});
  return velocities_[0];
}

template <int Dim, class T>
void GeodesicShooting<Dim, T>::shoot(const std::vector<MomentumPointers<T>>& momenta, const ActiveBlocks<Dim>& blocks,
                                     const StartingVelocity& on_start) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  start(momenta, blocks, on_start);
  for (int k = 0; k < time_steps_; ++k) {
    for (auto& shared : lattices_) {
      advance<Dim, T>(shared->lattice, shared->moved, pointer(shared->position[k]), pointer(shared->position[k]),
                      lattice_, velocities_[end_of_step(k)].data(), dt, shared->predicted[k + 1].data());
      shared->sites.move(shared->predicted[k + 1].data(), shared->acting);
    }
    begin_velocity();
    for (std::size_t s = 0; s < states_.size(); ++s) {
      if (poll_) poll_();
      ScaleState& state = states_[s];
      const AxisBlocks<Dim> active = momenta_of(s);
      state.reached.push_back(state.transport->reached(state.shared->sites, active));
      const MomentumMasks<Dim>& reached = state.reached.back();
      state.transport->push(state.shared->sites, momenta[s].zeroth, momenta[s].first, active, reached,
                            mutable_pointer(state.zeroth), state.first.data());
      add_velocity(state, pointer(state.zeroth), pointer(state.first), reached, velocities_[end_of_step(k + 1)]);
      if (state.oriented) state.oriented->predict(k, velocities_[end_of_step(k)].data(), dt);
    }
    finish_velocity(k + 1, velocities_[end_of_step(k + 1)]);
    if (k + 1 == time_steps_) break;
    for (ScaleState& state : states_)
      if (state.oriented) state.oriented->correct(k + 1, velocities_[end_of_step(k + 1)].data(), dt);
    for (auto& shared : lattices_) {
      T* next = shared->position[k + 1].data();
      const T* here = pointer(shared->position[k]);
      const T* predicted = shared->predicted[k + 1].data();
      shared->moved.for_runs(shared->lattice, [&](std::size_t begin, std::size_t count) {  // half of what predicts
        for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i)
          next[i] = ((here ? here[i] : T(0)) + predicted[i]) / 2;
      });
      advance<Dim, T>(shared->lattice, shared->moved, next, shared->predicted[k + 1].data(), lattice_,
                      velocities_[end_of_step(k + 1)].data(), dt / 2, next);
    }
  }
  fill_between_steps();
}

template <int Dim, class T>
std::vector<double> GeodesicShooting<Dim, T>::hamiltonians(const std::vector<MomentumPointers<T>>& momenta) {
  std::vector<double> energies(time_steps_ + 1, 0.0);
  for (std::size_t s = 0; s < states_.size(); ++s) {
    energies[0] += states_[s].scale->total_energy(momenta[s].zeroth, momenta[s].first);
    for (int k = 0; k <= time_steps_ && states_[s].oriented; ++k) energies[k] += states_[s].oriented->energy(k);
  }
  for (int k = 1; k <= time_steps_; ++k) {
    for (auto& shared : lattices_)
      if (!shared->predicted[k].empty()) shared->sites.move(shared->predicted[k].data());
    for (std::size_t s = 0; s < states_.size(); ++s) {
      ScaleState& state = states_[s];
      if (!state.scale->has_fields()) continue;
      // With `exact` first orders reach an order 0 that their scale may not begin with.
      state.transport->push(state.shared->sites, momenta[s].zeroth, momenta[s].first, {},
                            state.transport->reached(state.shared->sites, {}), mutable_pointer(state.zeroth),
                            state.first.data());
      energies[k] += state.scale->total_energy(pointer(state.zeroth), pointer(state.first));
    }
  }
  return energies;
}

template <int Dim, class T>
void GeodesicShooting<Dim, T>::adjoint(const std::vector<MomentumPointers<T>>& momenta,
                                       std::vector<Field<T>>& velocity_duals,
                                       const std::vector<MomentumTargets<T>>& gradient,
                                       const std::vector<MomentumTargets<T>>& preconditioned) {
  for (const ScaleState& state : states_)
    if (state.reached.size() != static_cast<std::size_t>(time_steps_))
      throw std::logic_error("the adjoint of shooting is asked for where the last shoot did not come to its end");
  for (auto& shared : lattices_)
    if (!shared->position_dual.empty()) shared->acting.clear(shared->lattice, Dim, shared->position_dual.data());
  for (ScaleState& state : states_)
    if (state.oriented) state.oriented->begin_adjoint();
  gather_between_steps(velocity_duals);
  for (int k = time_steps_; k > 0; --k) {
    correct_adjoint(k, velocity_duals);
    synthesise_adjoint(k, velocity_duals[end_of_step(k)].data(), momenta, gradient, preconditioned);
    predict_adjoint(k, velocity_duals);
  }
  synthesise_adjoint(0, velocity_duals[0].data(), momenta, gradient, preconditioned);
}

/// Of the corrector X_k = X_{k-1} + dt/2 (v_{k-1}(X_{k-1}) + v_k(predicted_k)) the part that needs v_k, whose dual is
/// complete then. No X_N exists.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::correct_adjoint(int k, std::vector<Field<T>>& velocity_duals) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  const T* velocity = velocities_[end_of_step(k)].data();
  T* velocity_dual = velocity_duals[end_of_step(k)].data();
  for (auto& shared : lattices_) {
    shared->acting.clear(shared->lattice, Dim, shared->predicted_dual.data());
    if (k < time_steps_)
      advance_adjoint<Dim, T>(shared->lattice, shared->acting, shared->predicted[k].data(), lattice_, velocity, dt / 2,
                              shared->position_dual.data(), velocity_dual, shared->predicted_dual.data());
  }
  for (ScaleState& state : states_)
    if (state.oriented) state.oriented->correct_adjoint(k, velocity, dt, velocity_dual);
}

/// From the dual of v_k to those of the momenta at the start and, where they were pushed, of predicted_k.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::synthesise_adjoint(int k, const T* velocity_dual,
                                                  const std::vector<MomentumPointers<T>>& momenta,
                                                  const std::vector<MomentumTargets<T>>& gradient,
                                                  const std::vector<MomentumTargets<T>>& preconditioned) {
  for (auto& shared : lattices_) {
    if (shared->moved.is_empty()) continue;
    if (!shared->restricted.empty()) shared->prolongation.transpose(velocity_dual, shared->restricted.data());
    if (k == 0) continue;
    shared->sites.move(shared->predicted[k].data(), shared->moved);
    shared->sites.begin_adjoint(shared->acting);
  }
  for (std::size_t s = 0; s < states_.size(); ++s) {
    if (poll_) poll_();
    ScaleState& state = states_[s];
    SharedLattice& shared = *state.shared;
    const Lattice<Dim>& lattice = shared.lattice;
    if (state.oriented) state.oriented->add_velocity_adjoint(k, velocity_dual, gradient[s].oriented);
    const AxisBlocks<Dim> wanted = wanted_of(s);
    const MomentumMasks<Dim> masks = k == 0                    ? at_start(s, wanted)
                                     : wanted == momenta_of(s) ? state.reached[static_cast<std::size_t>(k) - 1]
                                                               : state.transport->reached(shared.sites, wanted);
    if (masks.is_empty()) continue;
    const T* on_lattice = shared.restricted.empty() ? velocity_dual : shared.restricted.data();
    T* first_dual = mutable_pointer(state.first);
    T* zeroth_dual = state.zeroth.empty() ? state.velocity.data() : state.zeroth.data();  // or scratch alone
    state.scale->synthesise_transpose(on_lattice, masks, zeroth_dual, first_dual);
    const T per_volume = static_cast<T>(1 / lattice.cell_volume());
    if (k > 0) {
      const AxisBlocks<Dim> start = momenta_of(s);
      const bool has_first =
          std::any_of(start.begin(), start.end(), [](const auto* blocks) { return !blocks || blocks->sites() > 0; });
      state.transport->push_adjoint(shared.sites, momenta[s].zeroth, has_first ? momenta[s].first : nullptr, wanted,
                                    zeroth_dual, first_dual, shared.predicted_dual.data(), gradient[s].zeroth,
                                    gradient[s].first);
      if (preconditioned[s].zeroth)
        state.transport->pull_back(shared.sites, on_lattice, per_volume, preconditioned[s].zeroth);
      continue;
    }
    const std::size_t field = state.scale->field_size();
    if (gradient[s].zeroth) add_fields<Dim, T>(lattice, masks.zeroth, zeroth_dual, gradient[s].zeroth);
    for (std::size_t axis = 0; first_dual && axis < Dim; ++axis)
      add_fields<Dim, T>(lattice, masks.first[axis], first_dual + axis * field, gradient[s].first + axis * field);
    if (T* sum = preconditioned[s].zeroth) {
#pragma omp parallel for simd schedule(static)
      for (std::size_t i = 0; i < field; ++i) sum[i] += per_volume * on_lattice[i];
    }
  }
}

/// What X_{k-1} and v_{k-1}(X_{k-1}) receive from corrector and predictor of step k; the latter takes the place of
/// `predicted_dual`, which has served.
template <int Dim, class T>
void GeodesicShooting<Dim, T>::predict_adjoint(int k, std::vector<Field<T>>& velocity_duals) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  const T* velocity = velocities_[end_of_step(k - 1)].data();
  T* velocity_dual = velocity_duals[end_of_step(k - 1)].data();
  for (ScaleState& state : states_)
    if (state.oriented) state.oriented->predict_adjoint(k - 1, velocity, dt, velocity_dual);
  for (auto& shared : lattices_) {
    shared->sites.end_adjoint(shared->acting, shared->predicted_dual.data());
    T* position_dual = mutable_pointer(shared->position_dual);
    T* through_velocity = shared->predicted_dual.data();
    if (position_dual)
      shared->acting.for_runs(shared->lattice, [&](std::size_t begin, std::size_t count) {
        for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) {
          const T predicted_dual = through_velocity[i];
          through_velocity[i] = position_dual[i] / 2 + predicted_dual;
          position_dual[i] += predicted_dual;
        }
      });
    advance_adjoint<Dim, T>(shared->lattice, shared->acting, pointer(shared->position[k - 1]), lattice_, velocity, dt,
                            through_velocity, velocity_dual, k > 1 ? position_dual : nullptr);
  }
}

template class GeodesicShooting<2, float>;
template class GeodesicShooting<3, float>;
template class GeodesicShooting<2, double>;
template class GeodesicShooting<3, double>;

}  // namespace saltus
