#include "core/registration/working_set.h"

#include "core/momenta/reweighting.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>

namespace saltus {
namespace {

/// The values of the elements `wanted`, from those that `theirs` has; both rise. Others stay what they are.
template <int Dim, class T>
void pick_elements(const std::vector<std::uint32_t>& theirs, const T* from, const std::vector<std::uint32_t>& wanted,
                   T* to) {
  for (std::size_t e = 0, k = 0; e < wanted.size(); ++e) {
    while (k < theirs.size() && theirs[k] < wanted[e]) ++k;
    if (k < theirs.size() && theirs[k] == wanted[e]) std::copy_n(from + (Dim - 1) * k, Dim - 1, to + (Dim - 1) * e);
  }
}

}  // namespace

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
    for (std::size_t n = 0; n < normals; ++n)
      stiffness += oriented.momenta->stiffness(n) / static_cast<double>(normals);
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
    for (std::uint32_t element : oriented.active) factors.push_back(factors_[oriented.range][element]);
  }
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::has_all_blocks(const FirstOrder& first) const {
  for (std::size_t r = first.range; r < first.range + first.fields; ++r)
    if (!blocks_[r].is_complete()) return false;
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
std::vector<MomentumPointers<T>> WorkingSet<Dim, T>::pointers(const std::vector<T>& x) const {
  std::vector<MomentumPointers<T>> all(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (has_zeroth(scales_[s]->options().orders)) all[s].zeroth = x.data() + zeroth_at_[s];
    if (oriented_[s].momenta) {
      all[s].elements = &oriented_[s].active;
      all[s].oriented = x.data() + sparsity_[oriented_[s].range].begin;
    }
    FirstOrder& first = first_[s];
    if (first.fields == 0) continue;
    all[s].first = all_sites(s, x);
    if (!first.along) continue;
    first.along->expand(all[s].first, first.spread.data());
    all[s].first = first.spread.data();
  }
  return all;
}

template <int Dim, class T>
std::vector<MomentumPointers<T>> WorkingSet<Dim, T>::evaluated(const std::vector<T>& x) {
  std::vector<MomentumPointers<T>> momenta = pointers(x);
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
  if (looks_everywhere_) blocks.wanted.assign(scales_.size(), {});
  return blocks;
}

template <int Dim, class T>
std::vector<MomentumTargets<T>> WorkingSet<Dim, T>::targets(std::vector<T>& gradient, bool with_first) {
  std::vector<MomentumTargets<T>> all(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (has_zeroth(scales_[s]->options().orders)) all[s].zeroth = gradient.data() + zeroth_at_[s];
    if (oriented_[s].momenta && with_first)
      all[s].oriented = oriented_[s].listed.empty() ? gradient.data() + sparsity_[oriented_[s].range].begin
                                                    : oriented_[s].gradient.data();
    if (first_[s].fields == 0 || !with_first) continue;
    all[s].first = first_[s].along ? first_[s].spread_gradient.data() : gradient_at_all_sites(s, gradient);
  }
  return all;
}

/// Brings the order-1 gradients from where `targets` had them made to x's layout, and preconditions them.
template <int Dim, class T>
void WorkingSet<Dim, T>::finish_gradient(std::vector<T>& gradient, std::vector<T>& preconditioned) {
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const FirstOrder& first = first_[s];
    if (first.fields == 0) continue;
    const std::size_t count = scales_[s]->field_size();
    T* all = gradient_at_all_sites(s, gradient);
    if (first.along) first.along->contract(first.spread_gradient.data(), all);
    if (shear_only_) drop_normal_components(first, count, all);
    for (int field = 0; field < first.fields; ++field) {
      const GroupSparsity& range = sparsity_[first.range + field];
      if (!has_all_blocks(first))
        blocks_[first.range + field].gather(Dim, all + field * count, gradient.data() + range.begin);
      precondition(range, gradient, preconditioned);
    }
  }
  for (const Oriented& oriented : oriented_) {
    if (!oriented.momenta) continue;
    const GroupSparsity& range = sparsity_[oriented.range];
    if (!oriented.listed.empty())
      pick_elements<Dim>(oriented.listed, oriented.gradient.data(), oriented.active, gradient.data() + range.begin);
    precondition(range, gradient, preconditioned);
  }
}

/// What may join beside the active elements, for a look at x.
template <int Dim, class T>
void WorkingSet<Dim, T>::list_candidates(std::size_t scale, const std::vector<T>& x) {
  Oriented& oriented = oriented_[scale];
  const std::vector<std::uint32_t>& candidates = oriented.momenta->turned();
  const T* values = x.data() + sparsity_[oriented.range].begin;
  oriented.listed.clear();
  std::set_union(candidates.begin(), candidates.end(), oriented.active.begin(), oriented.active.end(),
                 std::back_inserter(oriented.listed));
  oriented.values.assign((Dim - 1) * oriented.listed.size(), T(0));
  oriented.gradient.assign(oriented.values.size(), T(0));
  pick_elements<Dim>(oriented.active, values, oriented.listed, oriented.values.data());
}

/// Whether none of the two sites beside an element's, along its normal, pulls harder.
template <int Dim, class T>
bool WorkingSet<Dim, T>::is_ridge(const Oriented& oriented, std::uint32_t element,
                                  const std::vector<float>& pull) const {
  const Lattice<Dim>& lattice = oriented.momenta->lattice();
  const std::size_t site = oriented.momenta->site_of(element);
  const T* normal = oriented.momenta->turned_normals().data() + Dim * site;
  double steps[Dim], most = 0;
  for (int a = 0; a < Dim; ++a) most = std::max(most, std::abs(steps[a] = normal[a] / lattice.spacing[a]));
  for (int side : {-1, 1}) {
    std::size_t rest = site, stride = 1, beside = 0;
    bool is_inside = true;
    for (int a = 0; a < Dim; ++a) {
      const auto length = static_cast<std::size_t>(lattice.size[a]);
      const long at = static_cast<long>(rest % length) + side * std::lround(steps[a] / most);
      is_inside = is_inside && at >= 0 && at < lattice.size[a];
      beside += static_cast<std::size_t>(at) * stride;
      rest /= length;
      stride *= length;
    }
    if (is_inside && pull[beside] > pull[site]) return false;
  }
  return true;
}

/// The elements that are to be there from now on; `changes` becomes true when they are not those that are.
template <int Dim, class T>
std::vector<std::uint32_t> WorkingSet<Dim, T>::wanted_elements(const Oriented& oriented, const MinimiserState<T>& state,
                                                               bool& changes) {
  const GroupSparsity& range = sparsity_[oriented.range];
  const std::vector<float>& factors = factors_[oriented.range];
  const auto is_zero = [](const T* values) {
    return std::all_of(values, values + Dim - 1, [](T value) { return value == T(0); });
  };
  const auto excess = [&](std::uint32_t element, const T* gradient) {  // how many times its weight an element pulls
    double square = 0;
    for (int c = 0; c < Dim - 1; ++c) square += static_cast<double>(gradient[c]) * gradient[c];
    return std::sqrt(square) / (factors.empty() ? range.weight : range.weight * factors[element]);
  };
  const auto pulls = [&](std::uint32_t element, const T* gradient) { return excess(element, gradient) > 1; };
  std::vector<std::uint32_t> staying, joining;
  for (std::size_t e = 0; e < oriented.active.size(); ++e) {
    const std::size_t at = range.begin + (Dim - 1) * e;
    bool stays =
        range.weight == 0 || !is_zero(state.x.data() + at) || pulls(oriented.active[e], state.gradient.data() + at);
    for (const CurvaturePair<T>& pair : state.pairs) stays = stays || !is_zero(pair.s.data() + at);
    if (stays) staying.push_back(oriented.active[e]);
  }
  // Of those that pull side by side across an interface the one that pulls most joins; a neighbour may when it still
  // pulls at the next look.
  std::vector<float> pull(oriented.listed.empty() ? 0 : oriented.momenta->lattice().sites());
  for (std::size_t e = 0; e < oriented.listed.size(); ++e) {
    float& most = pull[oriented.momenta->site_of(oriented.listed[e])];
    most = std::max(most, static_cast<float>(excess(oriented.listed[e], oriented.gradient.data() + (Dim - 1) * e)));
  }
  for (std::size_t e = 0; e < oriented.listed.size(); ++e)
    if (excess(oriented.listed[e], oriented.gradient.data() + (Dim - 1) * e) > 1 &&
        !std::binary_search(oriented.active.begin(), oriented.active.end(), oriented.listed[e]) &&
        is_ridge(oriented, oriented.listed[e], pull))
      joining.push_back(oriented.listed[e]);
  const std::size_t idle = oriented.active.size() - staying.size();
  const bool shrinks = idle > 0 && 4 * idle >= oriented.active.size();
  changes = changes || shrinks || !joining.empty();
  const std::vector<std::uint32_t>& kept = shrinks ? staying : oriented.active;
  std::vector<std::uint32_t> now;
  std::merge(kept.begin(), kept.end(), joining.begin(), joining.end(), std::back_inserter(now));
  return now;
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

/// Marks the blocks that have to be there: momenta that are, or were within the pairs, other than 0, and those that
/// want to be. Whether these are not the ones that are; blocks that may leave stay marked while they are few.
template <int Dim, class T>
bool WorkingSet<Dim, T>::wanted_blocks(MinimiserState<T>& state, std::vector<std::vector<char>>& wanted) {
  wanted.assign(blocks_.size(), {});
  std::size_t active = 0, idle = 0, joining = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const FirstOrder& first = first_[s];
    for (int field = 0; field < first.fields; ++field) {
      const std::size_t r = first.range + field;
      const GroupSparsity& range = sparsity_[r];
      const BlockSet<Dim>& blocks = blocks_[r];
      std::vector<char>& needed = wanted[r];
      needed.assign(blocks.blocks(), range.weight == 0);
      blocks.mark_nonzero(Dim, state.x.data() + range.begin, needed);
      for (const CurvaturePair<T>& pair : state.pairs) blocks.mark_nonzero(Dim, pair.s.data() + range.begin, needed);
      const T* gradient = gradient_at_all_sites(s, state.gradient) + field * scales_[s]->field_size();
      const std::vector<float>& factors = factors_[r];
      const std::size_t count = needed.size();
      std::vector<char> is_active(count, 0);
      for (std::uint32_t block : blocks.active()) is_active[block] = 1;
#pragma omp parallel for schedule(static)
      for (std::size_t block = 0; block < count; ++block)
        if (!needed[block] && (looks_everywhere_ || is_active[block]))
          needed[block] = blocks.any_site(block, [&](std::size_t site) {
            double square = 0;
            for (int k = 0; k < Dim; ++k) {
              const double g = gradient[Dim * site + k];
              square += g * g;
            }
            return std::sqrt(square) > (factors.empty() ? range.weight : range.weight * factors[site]);
          });
      const auto all = static_cast<std::size_t>(std::count(needed.begin(), needed.end(), 1));
      std::size_t staying = 0;
      for (std::uint32_t block : blocks.active()) staying += needed[block];
      active += blocks.active().size();
      idle += blocks.active().size() - staying;
      joining += all - staying;
    }
  }
  const bool shrinks = idle > 0 && 4 * idle >= active;
  for (std::size_t r = 0; r < blocks_.size() && !shrinks; ++r)
    for (std::uint32_t block : blocks_[r].active()) wanted[r][block] = 1;
  return joining > 0 || shrinks;
}

template <int Dim, class T>
typename WorkingSet<Dim, T>::Layout WorkingSet<Dim, T>::layout() const {
  Layout layout{zeroth_at_, {}, blocks_, active_elements(), {}};
  for (const GroupSparsity& range : sparsity_) layout.begins.push_back(range.begin);
  for (const FirstOrder& first : first_) layout.was_complete.push_back(has_all_blocks(first));
  return layout;
}

/// Values in x's layout as it is now from those in the layout before; what was not there is 0.
template <int Dim, class T>
void WorkingSet<Dim, T>::reshape(const Layout& before, std::vector<T>& values) const {
  std::vector<T> now(size_);
  for (std::size_t s = 0; s < scales_.size(); ++s)
    if (has_zeroth(scales_[s]->options().orders))
      std::copy_n(values.data() + before.zeroth_at[s], scales_[s]->field_size(), now.data() + zeroth_at_[s]);
  for (std::size_t r = 0; r < blocks_.size(); ++r)
    blocks_[r].gather_from(before.blocks[r], Dim, values.data() + before.begins[r], now.data() + sparsity_[r].begin);
  for (std::size_t s = 0; s < scales_.size(); ++s)
    if (oriented_[s].momenta)
      pick_elements<Dim>(before.elements[s], values.data() + before.begins[oriented_[s].range], oriented_[s].active,
                         now.data() + sparsity_[oriented_[s].range].begin);
  values = std::move(now);
}

template <int Dim, class T>
void WorkingSet<Dim, T>::precondition(const GroupSparsity& range, const std::vector<T>& gradient,
                                      std::vector<T>& preconditioned) const {
  const T factor = static_cast<T>(range.inverse_stiffness);
  for (std::size_t i = range.begin; i < range.end; ++i) preconditioned[i] = factor * gradient[i];
}

/// Gradients of what has joined, from where the last evaluation left them. What was complete had them in the state.
template <int Dim, class T>
void WorkingSet<Dim, T>::fetch_gradients(const Layout& before, MinimiserState<T>& state) const {
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (int field = 0; field < first_[s].fields && !before.was_complete[s]; ++field) {
      const GroupSparsity& range = sparsity_[first_[s].range + field];
      blocks_[first_[s].range + field].gather(Dim, first_[s].gradient.data() + field * scales_[s]->field_size(),
                                              state.gradient.data() + range.begin);
      precondition(range, state.gradient, state.preconditioned);
    }
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::revise(MinimiserState<T>& state) {
  std::vector<std::vector<char>> wanted;
  bool changes = wanted_blocks(state, wanted);
  std::vector<std::vector<std::uint32_t>> elements(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s)
    if (oriented_[s].momenta) elements[s] = wanted_elements(oriented_[s], state, changes);
  if (!changes) return false;

  const Layout before = layout();
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (std::size_t r = first_[s].range; r < first_[s].range + first_[s].fields; ++r) {
      std::vector<std::uint32_t> numbers;
      for (std::size_t block = 0; block < wanted[r].size(); ++block)
        if (wanted[r][block]) numbers.push_back(static_cast<std::uint32_t>(block));
      blocks_[r] = BlockSet<Dim>(scales_[s]->lattice(), std::move(numbers));
    }
  std::vector<std::vector<std::uint32_t>> looked(scales_.size());  // lay_out forgets them
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    oriented_[s].active = std::move(elements[s]);
    looked[s] = oriented_[s].listed;
  }
  lay_out();
  gather_factors();

  reshape(before, state.x);
  reshape(before, state.gradient);
  reshape(before, state.preconditioned);
  for (CurvaturePair<T>& pair : state.pairs) {
    reshape(before, pair.s);
    reshape(before, pair.y);
    reshape(before, pair.y_preconditioned);
  }
  fetch_gradients(before, state);
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (looked[s].empty()) continue;
    const GroupSparsity& range = sparsity_[oriented_[s].range];
    pick_elements<Dim>(looked[s], oriented_[s].gradient.data(), oriented_[s].active,
                       state.gradient.data() + range.begin);
    precondition(range, state.gradient, state.preconditioned);
  }
  return true;
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
FirstOrderPromise WorkingSet<Dim, T>::promise(std::vector<T>& gradient, double similarity) {
  double gain = 0, along = 0, across = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (int axis = 0; axis < first_[s].fields; ++axis) {
      const std::size_t r = first_[s].range + axis;
      const T* all = gradient_at_all_sites(s, gradient) + axis * scales_[s]->field_size();
      for (std::size_t site = 0; site < scales_[s]->lattice().sites(); ++site) {
        double square = 0;
        for (int k = 0; k < Dim; ++k) square += static_cast<double>(all[Dim * site + k]) * all[Dim * site + k];
        const double above = std::sqrt(square) - sparsity_[r].weight * (factors_[r].empty() ? 1.0 : factors_[r][site]);
        if (!(above > 0)) continue;
        const double normal = static_cast<double>(all[Dim * site + axis]) * all[Dim * site + axis];
        gain += sparsity_[r].inverse_stiffness / 2 * above * above;
        along += sparsity_[r].inverse_stiffness * (square - normal) / (Dim - 1);
        across += sparsity_[r].inverse_stiffness * normal;
      }
    }
  FirstOrderPromise promise;
  if (similarity != 0) promise.gain = gain / std::abs(similarity);
  if (across > 0) promise.shear = along / across;
  return promise;
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::has_oriented() const {
  return std::any_of(oriented_.begin(), oriented_.end(), [](const Oriented& o) { return o.momenta != nullptr; });
}

template <int Dim, class T>
void WorkingSet<Dim, T>::turn(const InterfaceNormals<Dim, T>& interface) {
  std::vector<typename InterfaceNormals<Dim, T>::Normals> found(oriented_.size());
  bool has_elements = false;
  oblique_share_ = 0;
  for (std::size_t s = 0; s < oriented_.size(); ++s) {
    if (!oriented_[s].momenta) continue;
    found[s] = interface.on(oriented_[s].momenta->lattice());
    oblique_share_ = std::max(oblique_share_, found[s].oblique_share);
    has_elements = has_elements || !oriented_[s].active.empty();
  }
  const bool turns = has_elements || oblique_share_ >= least_oblique_share_;
  for (std::size_t s = 0; s < oriented_.size(); ++s)
    if (oriented_[s].momenta) oriented_[s].momenta->turn(turns ? std::move(found[s].values) : std::vector<T>());
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
void WorkingSet<Dim, T>::restore_turned_normals(const std::vector<std::vector<float>>& normals) {
  bool fits = normals.size() == oriented_.size();
  for (std::size_t s = 0; fits && s < normals.size(); ++s)
    fits = normals[s].empty() || (oriented_[s].momenta && normals[s].size() == scales_[s]->field_size());
  if (!fits)
    throw InvalidInput("the turned normals are those of " + std::to_string(normals.size()) + " scales for " +
                       std::to_string(oriented_.size()) + ", or of other lattices");
  for (std::size_t s = 0; s < normals.size(); ++s)
    if (oriented_[s].momenta) oriented_[s].momenta->turn({normals[s].begin(), normals[s].end()});
}

template <int Dim, class T>
void WorkingSet<Dim, T>::weigh(const SparsityRound& round, const std::vector<T>& x) {
  lets_blocks_join_ = round.lets_blocks_join;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (first_[s].fields == 0) continue;
    const Lattice<Dim>& lattice = scales_[s]->lattice();
    const int fields = first_[s].fields;
    std::vector<std::vector<float>> factors;
    if (oriented_[s].momenta) {
      factors_[oriented_[s].range].clear();
      if (!oriented_[s].momenta->turned().empty() || !oriented_[s].active.empty()) {
        weigh_with_oriented(round, s, x);
        continue;
      }
    }
    switch (round.weights) {
      case SparsityRound::Weights::Even:
        factors.assign(fields, std::vector<float>(round.factor == 1 ? 0 : lattice.sites(), round.factor));
        break;
      case SparsityRound::Weights::Reweighted:
        factors = reweighted_factors<Dim, T>(lattice, all_sites(s, x), fields);
        break;
      case SparsityRound::Weights::Debiased:
        factors = support_factors<Dim, T>(lattice, all_sites(s, x), fields);
        break;
    }
    std::move(factors.begin(), factors.end(), factors_.begin() + static_cast<std::ptrdiff_t>(first_[s].range));
  }
  gather_factors();
}

/// The same for a scale with oriented momenta: all its first orders, oriented or not, are judged together.
template <int Dim, class T>
void WorkingSet<Dim, T>::weigh_with_oriented(const SparsityRound& round, std::size_t scale, const std::vector<T>& x) {
  const FirstOrder& first = first_[scale];
  const Oriented& oriented = oriented_[scale];
  const Lattice<Dim>& lattice = scales_[scale]->lattice();
  const std::size_t normals = oriented.momenta->options().normals.size(), sites = lattice.sites();
  std::vector<std::vector<float>> sizes = momentum_sizes<Dim, T>(lattice, all_sites(scale, x), first.fields);
  sizes.resize(first.fields + normals, std::vector<float>(sites, 0.0f));
  const T* values = x.data() + sparsity_[oriented.range].begin;
  for (std::size_t e = 0; e < oriented.active.size(); ++e) {
    double square = 0;
    for (int c = 0; c < Dim - 1; ++c) square += std::pow(static_cast<double>(values[(Dim - 1) * e + c]), 2);
    const std::uint32_t element = oriented.active[e];
    sizes[first.fields + oriented.momenta->normal_of(element)][oriented.momenta->site_of(element)] =
        static_cast<float>(std::sqrt(square));
  }
  std::vector<std::vector<float>> factors;
  switch (round.weights) {
    case SparsityRound::Weights::Even:
      factors.assign(sizes.size(), std::vector<float>(round.factor == 1 ? 0 : sites, static_cast<float>(round.factor)));
      break;
    case SparsityRound::Weights::Reweighted:
      factors = reweighted_factors<Dim>(lattice, std::move(sizes));
      break;
    case SparsityRound::Weights::Debiased:
      factors = support_factors(std::move(sizes));
      break;
  }
  std::vector<float>& together = factors_[oriented.range];
  together.clear();
  for (std::size_t n = 0; n < normals; ++n)
    together.insert(together.end(), factors[first.fields + n].begin(), factors[first.fields + n].end());
  std::move(factors.begin(), factors.begin() + first.fields,
            factors_.begin() + static_cast<std::ptrdiff_t>(first.range));
}

template <int Dim, class T>
void WorkingSet<Dim, T>::restore_weights(const SparsityRound& round, const std::vector<std::vector<float>>& factors) {
  bool fits = factors.size() == sparsity_.size();
  for (std::size_t r = 0; fits && r < blocks_.size(); ++r)
    fits = factors[r].empty() || factors[r].size() == blocks_[r].all_sites();
  for (const Oriented& oriented : oriented_)
    if (fits && oriented.momenta)
      fits = factors[oriented.range].empty() || factors[oriented.range].size() == oriented.momenta->elements();
  if (!fits)
    throw InvalidInput("the sparsity factors are " + std::to_string(factors.size()) + " lists for " +
                       std::to_string(sparsity_.size()) + " fields of first-order momenta, or of other lengths");
  lets_blocks_join_ = round.lets_blocks_join;
  factors_ = factors;
  gather_factors();
}

template class WorkingSet<2, float>;
template class WorkingSet<3, float>;
template class WorkingSet<2, double>;
template class WorkingSet<3, double>;

}  // namespace saltus
