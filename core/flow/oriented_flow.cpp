#include "core/flow/oriented_flow.h"

#include "core/flow/point_steps.h"
#include "core/support/errors.h"

#include <algorithm>

namespace saltus {

template <int Dim, class T>
OrientedFlow<Dim, T>::OrientedFlow(OrientedMomenta<Dim, T>& momenta, const Lattice<Dim>& velocity_lattice,
                                   int time_steps, Evolution evolution)
    : momenta_(momenta),
      lattice_(velocity_lattice),
      prolongation_(momenta.lattice(), velocity_lattice, Dim),
      position_(static_cast<std::size_t>(time_steps)),
      predicted_(static_cast<std::size_t>(time_steps) + 1) {
  if (evolution != Evolution::Carried) transport_ = std::make_unique<ElementTransport<Dim, T>>(momenta, evolution);
  if (!prolongation_.is_identity()) own_.resize(Dim * momenta.lattice().sites());
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::begin(const std::vector<Element>* elements, const T* values) {
  elements_ = elements;
  values_ = values;
  if (is_empty()) return;
  if (*elements != placed_ || momenta_.turns() != placed_after_) {
    if (transport_)
      transport_->place(*elements, position_[0]);
    else
      momenta_.place(*elements, position_[0]);
    placed_ = *elements;
    placed_after_ = momenta_.turns();
  }
  for (std::size_t k = 1; k < predicted_.size(); ++k) {
    predicted_[k].resize(position_[0].size());
    if (k < position_.size()) position_[k].resize(position_[0].size());
  }
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::add_velocity(int k, T* velocity) {
  if (is_empty()) return;
  T* sum = own_.empty() ? velocity : own_.data();
  std::fill(own_.begin(), own_.end(), T(0));
  if (transport_) {
    transport_->transport(points_at(k), values_, transported_);
    momenta_.add_transported(*elements_, transported_, values_, sum);
  } else {
    momenta_.add_velocity(*elements_, points_at(k).data(), values_, sum);
  }
  if (!own_.empty()) prolongation_.add_to(own_.data(), velocity);
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::predict(int k, const T* velocity, T dt) {
  if (is_empty()) return;
  advance_points<Dim, T>(position_[k], position_[k], lattice_, velocity, dt, predicted_[k + 1]);
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::correct(int k, const T* velocity, T dt) {
  if (is_empty()) return;
  // Half of what predicts is the first half of the rule.
  for (std::size_t i = 0; i < position_[k].size(); ++i) position_[k][i] = (position_[k - 1][i] + predicted_[k][i]) / 2;
  advance_points<Dim, T>(position_[k], predicted_[k], lattice_, velocity, dt / 2, position_[k]);
}

template <int Dim, class T>
double OrientedFlow<Dim, T>::energy(int k) {
  if (is_empty()) return 0;
  if (!transport_)
    throw InvalidInput("oriented momenta with evolution carried have no energy along their flow; choose exact");
  transport_->transport(points_at(k), values_, transported_);
  return momenta_.energy(*elements_, transported_);
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::begin_adjoint() {
  if (is_empty()) return;
  for (std::vector<T>* dual : {&position_dual_, &predicted_dual_, &through_velocity_})
    dual->assign(position_[0].size(), T(0));
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::correct_adjoint(int k, const T* velocity, T dt, T* velocity_dual) {
  if (is_empty()) return;
  std::fill(predicted_dual_.begin(), predicted_dual_.end(), T(0));
  if (k + 1 == static_cast<int>(predicted_.size())) return;  // the last node's position is that of nobody
  advance_points_adjoint<Dim, T>(predicted_[k], lattice_, velocity, dt / 2, position_dual_, velocity_dual,
                                 &predicted_dual_);
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::add_velocity_adjoint(int k, const T* velocity_dual, T* values_dual) {
  if (is_empty()) return;
  if (!own_.empty()) {
    prolongation_.transpose(velocity_dual, own_.data());
    velocity_dual = own_.data();
  }
  T* points_dual = k == 0 ? nullptr : predicted_dual_.data();
  if (!transport_) {
    momenta_.add_velocity_adjoint(*elements_, points_at(k).data(), values_, velocity_dual, values_dual, points_dual);
    return;
  }
  transport_->transport(points_at(k), values_, transported_);
  transported_duals_.resize(transported_.size());
  momenta_.add_transported_adjoint(*elements_, transported_, values_, velocity_dual, points_dual != nullptr,
                                   transported_duals_);
  transport_->adjoint(points_at(k), values_, transported_duals_, values_dual, points_dual);
}

template <int Dim, class T>
void OrientedFlow<Dim, T>::predict_adjoint(int k, const T* velocity, T dt, T* velocity_dual) {
  if (is_empty()) return;
  for (std::size_t i = 0; i < position_dual_.size(); ++i) {
    through_velocity_[i] = position_dual_[i] / 2 + predicted_dual_[i];
    position_dual_[i] += predicted_dual_[i];
  }
  advance_points_adjoint<Dim, T>(position_[k], lattice_, velocity, dt, through_velocity_, velocity_dual,
                                 k > 0 ? &position_dual_ : nullptr);
}

template class OrientedFlow<2, float>;
template class OrientedFlow<3, float>;
template class OrientedFlow<2, double>;
template class OrientedFlow<3, double>;

}  // namespace saltus
