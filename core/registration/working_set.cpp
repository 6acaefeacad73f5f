#include "core/registration/working_set.h"

#include "core/registration/pick_elements.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>

namespace saltus {

template <int Dim, class T>
WorkingSet<Dim, T>::WorkingSet(std::vector<MomentumScale<Dim, T>*> scales, double sparsity, double oriented_sparsity)
    : scales_(std::move(scales)) {
  for (const MomentumScale<Dim, T>* scale : scales_) {
    FirstOrder& first = first_.emplace_back();
    first.range = sparsity_.size();
    if (!scale->has_first_order()) continue;
    const double weight = sparsity * scale->options().first_weight * scale->lattice().cell_volume();
    if (scale->options().direction.empty()) {
      first.fields = Dim;
      for (int axis = 0; axis < Dim; ++axis)
        sparsity_.push_back({0, 0, Dim, weight, 1 / scale->first_order_stiffness(axis), {}});
    } else {
      first.fields = 1;
      first.along = std::make_unique<DirectionalMomentum<Dim, T>>(scale->options().direction);
      first.spread.resize(Dim * scale->field_size());
      first.spread_gradient.resize(Dim * scale->field_size());
      // The stiffness of m_w is sum_i w_i^2 times those of the axes; one number must do, and their mean is near.
      double stiffness = 0;
      for (int axis = 0; axis < Dim; ++axis) stiffness += scale->first_order_stiffness(axis) / Dim;
      sparsity_.push_back({0, 0, Dim, weight, 1 / stiffness, {}});
    }
    for (int field = 0; field < first.fields; ++field) blocks_.push_back(BlockSet<Dim>::all(scale->lattice()));
  }
  oriented_.resize(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    Oriented& oriented = oriented_[s];
    oriented.momenta = scales_[s]->oriented();
    oriented.range = sparsity_.size();
    if (!oriented.momenta) continue;
    const double weight =
        oriented_sparsity * sparsity * scales_[s]->options().first_weight * scales_[s]->lattice().cell_volume();
    // All normals have the same stiffness where samples are cubes; one number must do, and their mean is near.
    const std::size_t normals = oriented.momenta->options().normals.size();
    double stiffness = 0;
    // An element stands for the sites beside it that have none, and has to go as far as all of them would.
    for (std::size_t n = 0; n < normals; ++n)
      stiffness += oriented.momenta->stiffness(n) / oriented.momenta->sites_of_each(n) / static_cast<double>(normals);
    sparsity_.push_back({0, 0, Dim - 1, weight, 1 / stiffness, {}});
  }
  factors_.resize(sparsity_.size());
  lay_out();
}

/// Where everything lies in x with the blocks as they are.
template <int Dim, class T>
void WorkingSet<Dim, T>::lay_out() {
  size_ = 0;
  zeroth_at_.clear();
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    zeroth_at_.push_back(size_);
    if (has_zeroth(scales_[s]->options().orders)) size_ += scales_[s]->field_size();
    for (std::size_t r = first_[s].range; r < first_[s].range + first_[s].fields; ++r) {
      sparsity_[r].begin = size_;
      sparsity_[r].end = size_ += Dim * blocks_[r].sites();
    }
    first_[s].momentum.clear();
    if (has_all_blocks(first_[s])) first_[s].momentum.shrink_to_fit();
    if (!oriented_[s].momenta) continue;
    sparsity_[oriented_[s].range].begin = size_;
    sparsity_[oriented_[s].range].end = size_ += (Dim - 1) * oriented_[s].active.size();
    oriented_[s].listed.clear();
  }
}

template <int Dim, class T>
void WorkingSet<Dim, T>::gather_factors() {
  for (std::size_t r = 0; r < blocks_.size(); ++r) {
    sparsity_[r].factors = std::vector<float>(factors_[r].empty() ? 0 : blocks_[r].sites());
    if (!factors_[r].empty()) blocks_[r].gather(1, factors_[r].data(), sparsity_[r].factors.data());
  }
  for (const Oriented& oriented : oriented_) {
    if (!oriented.momenta) continue;
    std::vector<float>& factors = sparsity_[oriented.range].factors;
    factors.clear();
    if (factors_[oriented.range].empty()) continue;
    for (std::uint32_t element : oriented.active) factors.push_back(factor_of(oriented, element));
  }
}

template <int Dim, class T>
float WorkingSet<Dim, T>::factor_of(const Oriented& oriented, std::uint32_t element) const {
  const std::vector<float>& factors = factors_[oriented.range];
  if (factors.empty()) return 1;
  const bool is_by_site = factors.size() == oriented.momenta->lattice().sites();
  return factors[is_by_site ? oriented.momenta->site_of(element) : element];
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::has_all_blocks(const FirstOrder& first) const {
  for (std::size_t r = first.range; r < first.range + first.fields; ++r)
    if (!blocks_[r].is_complete()) return false;
  return true;
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::has_no_blocks(const FirstOrder& first) const {
  for (std::size_t r = first.range; r < first.range + first.fields; ++r)
    if (blocks_[r].sites() > 0) return false;
  return true;
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::has_more() const {
  return lets_blocks_join_ && (!std::all_of(first_.begin(), first_.end(), [&](const FirstOrder& first) {
           return has_all_blocks(first);
         }) || std::any_of(oriented_.begin(), oriented_.end(), [](const Oriented& o) { return o.momenta != nullptr; }));
}

/// The active blocks by scale and axis; m_w along a direction is spread to all axes of its sites.
template <int Dim, class T>
std::vector<AxisBlocks<Dim>> WorkingSet<Dim, T>::axis_blocks() const {
  std::vector<AxisBlocks<Dim>> all(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (int axis = 0; axis < Dim && first_[s].fields > 0; ++axis)
      all[s][axis] = &blocks_[first_[s].range + (first_[s].along ? 0 : axis)];
  return all;
}

/// The order-1 fields of a scale at all sites, as they are in x: with all blocks active they lie there so.
template <int Dim, class T>
const T* WorkingSet<Dim, T>::all_sites(std::size_t scale, const std::vector<T>& x) const {
  FirstOrder& first = first_[scale];
  if (has_all_blocks(first)) return x.data() + sparsity_[first.range].begin;
  const std::size_t count = scales_[scale]->field_size();
  if (first.momentum.empty()) first.momentum.assign(first.fields * count, T(0));
  // Outside the active blocks it stays 0 from one x to the next; lay_out empties it when blocks change.
  for (int field = 0; field < first.fields; ++field)
    blocks_[first.range + field].scatter_within(Dim, x.data() + sparsity_[first.range + field].begin,
                                                first.momentum.data() + field * count);
  return first.momentum.data();
}

/// Where their gradient is at all sites, as the last evaluation left it.
template <int Dim, class T>
T* WorkingSet<Dim, T>::gradient_at_all_sites(std::size_t scale, std::vector<T>& gradient) {
  FirstOrder& first = first_[scale];
  if (has_all_blocks(first)) return gradient.data() + sparsity_[first.range].begin;
  first.gradient.resize(first.fields * scales_[scale]->field_size());
  return first.gradient.data();
}

template <int Dim, class T>
std::vector<MomentumPointers<T>> WorkingSet<Dim, T>::pointers(const std::vector<T>& x, Reads reads) const {
  std::vector<MomentumPointers<T>> all(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (has_zeroth(scales_[s]->options().orders)) all[s].zeroth = x.data() + zeroth_at_[s];
    if (oriented_[s].momenta) {
      all[s].elements = &oriented_[s].active;
      all[s].oriented = x.data() + sparsity_[oriented_[s].range].begin;
    }
    FirstOrder& first = first_[s];
    if (first.fields == 0) continue;
    if (reads == Reads::WithinBlocks && !first.along && has_no_blocks(first)) {
      first.gradient.resize(first.fields * scales_[s]->field_size());
      all[s].first = first.gradient.data();  // of which nothing is read; that it is not null says that there is order 1
      continue;
    }
    all[s].first = all_sites(s, x);
    if (!first.along) continue;
    first.along->expand(all[s].first, first.spread.data());
    all[s].first = first.spread.data();
  }
  return all;
}

template <int Dim, class T>
std::vector<MomentumPointers<T>> WorkingSet<Dim, T>::evaluated(const std::vector<T>& x) {
  std::vector<MomentumPointers<T>> momenta = pointers(x, Reads::WithinBlocks);
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (!oriented_[s].momenta) continue;
    oriented_[s].listed.clear();
    if (!looks_everywhere_) continue;
    list_candidates(s, x);
    if (oriented_[s].listed.empty()) continue;
    momenta[s].elements = &oriented_[s].listed;
    momenta[s].oriented = oriented_[s].values.data();
  }
  return momenta;
}

template <int Dim, class T>
ActiveBlocks<Dim> WorkingSet<Dim, T>::blocks() const {
  ActiveBlocks<Dim> blocks{axis_blocks(), axis_blocks()};
  for (std::size_t s = 0; s < scales_.size(); ++s)
    if (looks_at_blocks(s)) blocks.wanted[s] = {};
  return blocks;
}

/// Whether a scale has oriented momenta that are turned, or are there.
template <int Dim, class T>
bool WorkingSet<Dim, T>::has_elements(std::size_t scale) const {
  const Oriented& oriented = oriented_[scale];
  return oriented.momenta && (!oriented.momenta->turned().empty() || !oriented.active.empty());
}

/// Whether elements, once turned, keep blocks of their scale out.
template <int Dim, class T>
bool WorkingSet<Dim, T>::may_stand_alone(std::size_t scale) const {
  return elements_stand_alone_ && has_no_blocks(first_[scale]);
}

/// Whether an evaluation shows where blocks of a scale that are not active want to be.
template <int Dim, class T>
bool WorkingSet<Dim, T>::looks_at_blocks(std::size_t scale) const {
  return looks_everywhere_ && !(may_stand_alone(scale) && has_elements(scale));
}

template <int Dim, class T>
std::size_t WorkingSet<Dim, T>::dense_size() const {
  std::size_t size = 0;
  for (const MomentumScale<Dim, T>* scale : scales_)
    if (has_zeroth(scale->options().orders)) size += scale->field_size();
  return size;
}

template <int Dim, class T>
std::vector<MomentumTargets<T>> WorkingSet<Dim, T>::dense_targets(std::vector<T>& preconditioned) const {
  std::vector<MomentumTargets<T>> all(scales_.size());
  T* next = preconditioned.data();
  for (std::size_t s = 0; s < scales_.size(); ++s)
    if (has_zeroth(scales_[s]->options().orders)) {
      all[s].zeroth = next;
      next += scales_[s]->field_size();
    }
  return all;
}

template <int Dim, class T>
std::vector<MomentumTargets<T>> WorkingSet<Dim, T>::targets(std::vector<T>& gradient) {
  std::vector<MomentumTargets<T>> all(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (has_zeroth(scales_[s]->options().orders)) all[s].zeroth = gradient.data() + zeroth_at_[s];
    if (oriented_[s].momenta)
      all[s].oriented = oriented_[s].listed.empty() ? gradient.data() + sparsity_[oriented_[s].range].begin
                                                    : oriented_[s].gradient.data();
    if (first_[s].fields == 0) continue;
    all[s].first = first_[s].along ? first_[s].spread_gradient.data() : gradient_at_all_sites(s, gradient);
  }
  return all;
}

template <int Dim, class T>
void WorkingSet<Dim, T>::drop_normal_components(const FirstOrder& first, std::size_t field_size, T* values) const {
  if (first.along) {
    first.along->drop_normal(values);
    return;
  }
  for (std::size_t axis = 0; axis < Dim; ++axis)
    for (std::size_t i = axis; i < field_size; i += Dim) values[axis * field_size + i] = 0;
}

/// Brings the order-1 gradients from where `targets` had them made to x's layout.
template <int Dim, class T>
void WorkingSet<Dim, T>::finish_gradient(std::vector<T>& gradient) {
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const FirstOrder& first = first_[s];
    if (first.fields == 0) continue;
    const std::size_t count = scales_[s]->field_size();
    T* all = gradient_at_all_sites(s, gradient);
    if (first.along) first.along->contract(first.spread_gradient.data(), all);
    if (shear_only_) drop_normal_components(first, count, all);
    for (int field = 0; field < first.fields; ++field) {
      if (has_all_blocks(first)) continue;
      const std::size_t r = first.range + field;
      blocks_[r].gather(Dim, all + field * count, gradient.data() + sparsity_[r].begin);
    }
  }
  for (const Oriented& oriented : oriented_) {
    if (!oriented.momenta || oriented.listed.empty()) continue;
    pick_elements<Dim>(oriented.listed, oriented.gradient.data(), oriented.active,
                       gradient.data() + sparsity_[oriented.range].begin);
  }
}

template <int Dim, class T>
std::vector<std::vector<std::uint32_t>> WorkingSet<Dim, T>::active_blocks() const {
  std::vector<std::vector<std::uint32_t>> active;
  for (const BlockSet<Dim>& blocks : blocks_) active.push_back(blocks.active());
  return active;
}

template <int Dim, class T>
void WorkingSet<Dim, T>::set_active_blocks(const std::vector<std::vector<std::uint32_t>>& active) {
  if (active.size() > blocks_.size())
    throw InvalidInput("the active blocks are those of " + std::to_string(active.size()) + " fields and there are " +
                       std::to_string(blocks_.size()) + " fields of first-order momenta; give no more than that");
  std::vector<BlockSet<Dim>> now;
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (std::size_t r = first_[s].range; r < first_[s].range + first_[s].fields; ++r) {
      const Lattice<Dim>& lattice = scales_[s]->lattice();
      now.push_back(r < active.size()          ? BlockSet<Dim>(lattice, active[r])
                    : sparsity_[r].weight == 0 ? BlockSet<Dim>::all(lattice)
                                               : BlockSet<Dim>::none(lattice));
    }
  blocks_ = std::move(now);
  lay_out();
  gather_factors();
}

template <int Dim, class T>
std::vector<std::vector<std::uint32_t>> WorkingSet<Dim, T>::active_elements() const {
  std::vector<std::vector<std::uint32_t>> active;
  for (const Oriented& oriented : oriented_) active.push_back(oriented.active);
  return active;
}

template <int Dim, class T>
void WorkingSet<Dim, T>::set_active_elements(const std::vector<std::vector<std::uint32_t>>& active) {
  for (std::size_t s = 0; s < active.size(); ++s) {
    const std::vector<std::uint32_t>& list = active[s];
    const std::size_t count = s < oriented_.size() && oriented_[s].momenta ? oriented_[s].momenta->elements() : 0;
    if (!list.empty() &&
        (list.back() >= count || std::adjacent_find(list.begin(), list.end(), std::greater_equal<>()) != list.end()))
      throw InvalidInput("the active elements of scale " + std::to_string(s + 1) + " are no rising numbers below " +
                         std::to_string(count) + ", of which there are so many elements");
  }
  for (std::size_t s = 0; s < oriented_.size(); ++s)
    oriented_[s].active = s < active.size() ? active[s] : std::vector<std::uint32_t>();
  lay_out();
  gather_factors();
}

template <int Dim, class T>
double WorkingSet<Dim, T>::active_block_share() const {
  std::size_t active = 0, all = 0;
  for (const BlockSet<Dim>& blocks : blocks_) {
    active += blocks.active().size();
    all += blocks.blocks();
  }
  return all > 0 ? static_cast<double>(active) / static_cast<double>(all) : 0;
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::has_oriented() const {
  return std::any_of(oriented_.begin(), oriented_.end(), [](const Oriented& o) { return o.momenta != nullptr; });
}

template <int Dim, class T>
void WorkingSet<Dim, T>::turn(const InterfaceNormals<Dim, T>& interface, bool is_for_weights) {
  std::vector<typename InterfaceNormals<Dim, T>::Normals> found(oriented_.size());
  bool has_elements = false;
  oblique_share_ = 0;
  for (std::size_t s = 0; s < oriented_.size(); ++s) {
    if (!oriented_[s].momenta) continue;
    found[s] = interface.on(oriented_[s].momenta->lattice(), is_for_weights);
    oblique_share_ = std::max(oblique_share_, found[s].oblique_share);
    has_elements = has_elements || !oriented_[s].active.empty();
  }
  const bool turns = has_elements || oblique_share_ >= least_oblique_share_;
  for (std::size_t s = 0; s < oriented_.size(); ++s) {
    if (!oriented_[s].momenta) continue;
    oriented_[s].strengths = std::move(found[s].strengths);
    std::vector<T> normals = turns ? std::move(found[s].values) : std::vector<T>();
    if (!may_stand_alone(s)) InterfaceNormals<Dim, T>::leave_out_axes(normals);
    oriented_[s].momenta->turn(std::move(normals), oriented_[s].active);
  }
}

template <int Dim, class T>
std::vector<std::vector<float>> WorkingSet<Dim, T>::turned_normals() const {
  std::vector<std::vector<float>> normals(oriented_.size());
  for (std::size_t s = 0; s < oriented_.size(); ++s)
    if (oriented_[s].momenta)
      normals[s].assign(oriented_[s].momenta->turned_normals().begin(), oriented_[s].momenta->turned_normals().end());
  return normals;
}

template <int Dim, class T>
std::vector<std::vector<std::uint32_t>> WorkingSet<Dim, T>::turned_elements() const {
  std::vector<std::vector<std::uint32_t>> elements(oriented_.size());
  for (std::size_t s = 0; s < oriented_.size(); ++s)
    if (oriented_[s].momenta) elements[s] = oriented_[s].momenta->turned();
  return elements;
}

template <int Dim, class T>
void WorkingSet<Dim, T>::restore_turned(const std::vector<std::vector<float>>& normals,
                                        const std::vector<std::vector<std::uint32_t>>& elements) {
  bool fits = normals.size() == oriented_.size() && elements.size() == oriented_.size();
  for (std::size_t s = 0; fits && s < normals.size(); ++s) {
    const auto* momenta = oriented_[s].momenta;
    fits = normals[s].empty() ? elements[s].empty() : momenta && normals[s].size() == scales_[s]->field_size();
    if (!fits || elements[s].empty()) continue;
    std::vector<char> has_one(momenta->lattice().sites(), 0);
    fits = elements[s].back() < momenta->elements() &&
           std::adjacent_find(elements[s].begin(), elements[s].end(), std::greater_equal<>()) == elements[s].end();
    for (std::size_t i = 0; fits && i < elements[s].size(); ++i) {
      const std::size_t site = momenta->site_of(elements[s][i]);
      const Eigen::Map<const Eigen::Matrix<float, Dim, 1>> n(normals[s].data() + Dim * site);
      const double along =
          n.template cast<double>().dot(momenta->options().normals[momenta->normal_of(elements[s][i])]);
      fits = !has_one[site] && std::abs(n.norm() - 1) < 1e-3f && along >= 0;
      has_one[site] = 1;
    }
  }
  if (!fits)
    throw InvalidInput("the turned normals and elements of " + std::to_string(normals.size()) +
                       " scales do not fit the " + std::to_string(oriented_.size()) +
                       " scales that there are; start again without them");
  for (std::size_t s = 0; s < normals.size(); ++s)
    if (oriented_[s].momenta) oriented_[s].momenta->restore_turned({normals[s].begin(), normals[s].end()}, elements[s]);
}

template class WorkingSet<2, float>;
template class WorkingSet<3, float>;
template class WorkingSet<2, double>;
template class WorkingSet<3, double>;

}  // namespace saltus
