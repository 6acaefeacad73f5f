#include "core/flow/backward_map.h"

#include "core/flow/particle_steps.h"

namespace saltus {

template <int Dim, class T>
BackwardMap<Dim, T>::BackwardMap(const Lattice<Dim>& points, const Lattice<Dim>& velocity_lattice, int time_steps)
    : points_(points),
      lattice_(velocity_lattice),
      time_steps_(time_steps),
      position_(time_steps + 1),
      predicted_(Dim * points.sites()) {
  for (int k = 0; k < time_steps; ++k) position_[k].resize(Dim * points.sites());
}

template <int Dim, class T>
const Field<T>& BackwardMap<Dim, T>::follow(const std::vector<Field<T>>& velocities) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  for (int k = time_steps_ - 1; k >= 0; --k) {
    const T* from = position_[k + 1].empty() ? nullptr : position_[k + 1].data();
    const T* v_next = velocities[k + 1].data();
    advance<Dim, T>(points_, from, from, lattice_, v_next, -dt, predicted_.data());
    T* to = position_[k].data();
    advance<Dim, T>(points_, from, from, lattice_, v_next, -dt / 2, to);
    advance<Dim, T>(points_, to, predicted_.data(), lattice_, velocities[k].data(), -dt / 2, to);
  }
  return position_[0];
}

template <int Dim, class T>
void BackwardMap<Dim, T>::adjoint(const std::vector<Field<T>>& velocities, const Field<T>& dual,
                                  std::vector<Field<T>>& velocity_duals) {
  const T dt = T(1) / static_cast<T>(time_steps_);
  Field<T> position_dual = dual, predicted_dual(dual.size()), through_velocity(dual.size());
  for (int k = 0; k < time_steps_; ++k) {
    const T* from = position_[k + 1].empty() ? nullptr : position_[k + 1].data();
    const T* v_next = velocities[k + 1].data();
    advance<Dim, T>(points_, from, from, lattice_, v_next, -dt, predicted_.data());
    std::fill(predicted_dual.begin(), predicted_dual.end(), T(0));
    advance_adjoint<Dim, T>(points_, predicted_.data(), lattice_, velocities[k].data(), -dt / 2, position_dual.data(),
                            plan_, velocity_duals[k].data(), predicted_dual.data());
    const std::size_t count = dual.size();
#pragma omp parallel for simd schedule(static)
    for (std::size_t i = 0; i < count; ++i) {
      through_velocity[i] = position_dual[i] / 2 + predicted_dual[i];
      position_dual[i] += predicted_dual[i];
    }
    advance_adjoint<Dim, T>(points_, from, lattice_, v_next, -dt, through_velocity.data(), plan_,
                            velocity_duals[k + 1].data(), from ? position_dual.data() : nullptr);
  }
}

template <int Dim, class T>
Field<T> forward_map(const Lattice<Dim>& points, const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities) {
  const int time_steps = static_cast<int>(velocities.size()) - 1;
  const T dt = T(1) / static_cast<T>(time_steps);
  Field<T> position(Dim * points.sites(), T(0)), predicted(position.size());
  for (int k = 0; k < time_steps; ++k) {
    advance<Dim, T>(points, position.data(), position.data(), lattice, velocities[k].data(), dt, predicted.data());
    advance<Dim, T>(points, position.data(), position.data(), lattice, velocities[k].data(), dt / 2, position.data());
    advance<Dim, T>(points, position.data(), predicted.data(), lattice, velocities[k + 1].data(), dt / 2,
                    position.data());
  }
  return position;
}

template class BackwardMap<2, float>;
template class BackwardMap<3, float>;
template class BackwardMap<2, double>;
template class BackwardMap<3, double>;
template Field<float> forward_map<2, float>(const Lattice<2>&, const Lattice<2>&, const std::vector<Field<float>>&);
template Field<float> forward_map<3, float>(const Lattice<3>&, const Lattice<3>&, const std::vector<Field<float>>&);
template Field<double> forward_map<2, double>(const Lattice<2>&, const Lattice<2>&, const std::vector<Field<double>>&);
template Field<double> forward_map<3, double>(const Lattice<3>&, const Lattice<3>&, const std::vector<Field<double>>&);

}  // namespace saltus
