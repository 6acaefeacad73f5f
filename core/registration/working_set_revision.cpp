#include "core/registration/pick_elements.h"
#include "core/registration/working_set.h"
#include "core/support/free_memory.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace saltus {
namespace {

/// How many times its weight an element has to pull to join beside one that is active: what it could add, that one
/// makes nearly as well.
constexpr double kBesideActive = 2.5;

}  // namespace

/// What may join beside the active elements, for a look at x.
template <int Dim, class T>
void WorkingSet<Dim, T>::list_candidates(std::size_t scale, const std::vector<T>& x) {
  Oriented& oriented = oriented_[scale];
  const std::vector<std::uint32_t>& candidates = oriented.momenta->candidates();
  const T* values = x.data() + sparsity_[oriented.range].begin;
  oriented.listed.clear();
  std::set_union(candidates.begin(), candidates.end(), oriented.active.begin(), oriented.active.end(),
                 std::back_inserter(oriented.listed));
  oriented.values.assign((Dim - 1) * oriented.listed.size(), T(0));
  oriented.gradient.assign(oriented.values.size(), T(0));
  pick_elements<Dim>(oriented.active, values, oriented.listed, oriented.values.data());
}

/// Whether any of the two sites beside an element's, along its normal's steepest axis, is_so(site).
template <int Dim, class T>
template <class IsSo>
bool WorkingSet<Dim, T>::any_beside(const Oriented& oriented, std::uint32_t element, IsSo&& is_so) const {
  const Lattice<Dim>& lattice = oriented.momenta->lattice();
  const int steepest = oriented.momenta->steepest_axis(oriented.momenta->normal_of(element));
  const std::size_t site = oriented.momenta->site_of(element);
  std::size_t stride = 1;
  for (int a = 0; a < steepest; ++a) stride *= static_cast<std::size_t>(lattice.size[a]);
  const auto length = static_cast<std::size_t>(lattice.size[steepest]);
  const std::size_t at = site / stride % length;
  return (at > 0 && is_so(site - stride)) || (at + 1 < length && is_so(site + stride));
}

/// The elements that are to be there from now on; `changes` becomes true when they are not those that are.
template <int Dim, class T>
std::vector<std::uint32_t> WorkingSet<Dim, T>::wanted_elements(const Oriented& oriented, const MinimiserState<T>& state,
                                                               bool& changes) {
  const GroupSparsity& range = sparsity_[oriented.range];
  const auto is_zero = [](const auto* values) {
    return std::all_of(values, values + Dim - 1, [](T value) { return value == T(0); });
  };
  const auto excess = [&](std::uint32_t element, const T* gradient) {  // how many times its weight an element pulls
    double square = 0;
    for (int c = 0; c < Dim - 1; ++c) square += static_cast<double>(gradient[c]) * gradient[c];
    return std::sqrt(square) / (range.weight * factor_of(oriented, element));
  };
  const auto pulls = [&](std::uint32_t element, const T* gradient) { return excess(element, gradient) > 1; };
  std::vector<std::uint32_t> staying, joining;
  for (std::size_t e = 0; e < oriented.active.size(); ++e) {
    const std::size_t at = range.begin + (Dim - 1) * e;
    bool stays =
        range.weight == 0 || !is_zero(state.x.data() + at) || pulls(oriented.active[e], state.gradient.data() + at);
    for (auto pair = state.pairs.begin(); !stays && pair != state.pairs.end(); ++pair)
      stays = !is_zero(pair->s.data() + at);
    if (stays) staying.push_back(oriented.active[e]);
  }
  // Of those that pull side by side across an interface the one that pulls most joins.
  const std::size_t sites = oriented.listed.empty() ? 0 : oriented.momenta->lattice().sites();
  std::vector<float> pull(sites);
  for (std::size_t e = 0; e < oriented.listed.size(); ++e) {
    float& most = pull[oriented.momenta->site_of(oriented.listed[e])];
    most = std::max(most, static_cast<float>(excess(oriented.listed[e], oriented.gradient.data() + (Dim - 1) * e)));
  }
  std::vector<char> is_taken(sites);
  if (sites > 0)
    for (std::uint32_t element : staying) is_taken[oriented.momenta->site_of(element)] = 1;
  for (std::size_t e = 0; e < oriented.listed.size(); ++e) {
    const std::uint32_t element = oriented.listed[e];
    const double pulled = excess(element, oriented.gradient.data() + (Dim - 1) * e);
    if (!(pulled > 1) || std::binary_search(oriented.active.begin(), oriented.active.end(), element)) continue;
    const std::size_t site = oriented.momenta->site_of(element);
    if (any_beside(oriented, element, [&](std::size_t beside) { return pull[beside] > pull[site]; })) continue;
    if (pulled > kBesideActive || !any_beside(oriented, element, [&](std::size_t beside) { return is_taken[beside]; }))
      joining.push_back(element);
  }
  const std::size_t idle = oriented.active.size() - staying.size();
  // Where x changes anyhow, nothing is lost by leaving.
  changes = changes || !joining.empty();
  const bool shrinks = idle > 0 && (changes || 4 * idle >= oriented.active.size());
  changes = changes || shrinks;
  const std::vector<std::uint32_t>& kept = shrinks ? staying : oriented.active;
  std::vector<std::uint32_t> now;
  std::merge(kept.begin(), kept.end(), joining.begin(), joining.end(), std::back_inserter(now));
  return now;
}

/// How many times its weight the group of a site pulls; NaN where neither is above 0. `gradient`: of the field alone.
template <int Dim, class T>
double WorkingSet<Dim, T>::pull_at(std::size_t field, std::size_t site, const T* gradient) const {
  double square = 0;
  for (int k = 0; k < Dim; ++k) square += static_cast<double>(gradient[Dim * site + k]) * gradient[Dim * site + k];
  const std::vector<float>& factors = factors_[field];
  return std::sqrt(square) / (sparsity_[field].weight * (factors.empty() ? 1.0 : static_cast<double>(factors[site])));
}

/// That of the group of a block that pulls most.
template <int Dim, class T>
double WorkingSet<Dim, T>::pull_of_block(std::size_t field, std::size_t block, const T* gradient) const {
  double most = 0;
  blocks_[field].any_site(block, [&](std::size_t site) {
    const double pull = pull_at(field, site, gradient);
    if (pull > most) most = pull;
    return false;
  });
  return most;
}

/// Of the blocks of a scale that are marked and not active only those stay marked that pull most, `room` of them. How
/// many do not.
template <int Dim, class T>
std::size_t WorkingSet<Dim, T>::keep_out(std::size_t scale, std::size_t room, std::vector<T>& gradient,
                                         std::vector<std::vector<char>>& wanted) {
  struct Joining {
    double pull;
    std::size_t field, block;
  };
  std::vector<Joining> joining;
  const FirstOrder& first = first_[scale];
  const T* all = gradient_at_all_sites(scale, gradient);
  for (std::size_t r = first.range; r < first.range + first.fields; ++r) {
    std::vector<char> is_active(wanted[r].size(), 0);
    for (std::uint32_t block : blocks_[r].active()) is_active[block] = 1;
    for (std::size_t block = 0; block < is_active.size(); ++block)
      if (wanted[r][block] && !is_active[block]) joining.push_back({0, r, block});
  }
#pragma omp parallel for schedule(static)
  for (Joining& one : joining)
    one.pull = pull_of_block(one.field, one.block, all + (one.field - first.range) * scales_[scale]->field_size());
  room = std::min(room, joining.size());
  // Of those that pull alike the first: the same ones whatever the sort does.
  const auto comes_before = [](const Joining& a, const Joining& b) {
    if (a.pull != b.pull) return a.pull > b.pull;
    return a.field != b.field ? a.field < b.field : a.block < b.block;
  };
  const auto end = joining.begin() + static_cast<std::ptrdiff_t>(room);
  std::nth_element(joining.begin(), end, joining.end(), comes_before);
  for (auto one = end; one != joining.end(); ++one) wanted[one->field][one->block] = 0;
  return joining.size() - room;
}

/// Marks the blocks whose momenta are other than 0 or want to be.
template <int Dim, class T>
void WorkingSet<Dim, T>::mark_needed_blocks(MinimiserState<T>& state, std::vector<std::vector<char>>& wanted) {
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const bool looks = looks_at_blocks(s);
    for (int field = 0; field < first_[s].fields; ++field) {
      const std::size_t r = first_[s].range + field;
      const BlockSet<Dim>& blocks = blocks_[r];
      std::vector<char>& needed = wanted[r];
      needed.assign(blocks.blocks(), sparsity_[r].weight == 0);
      blocks.mark_nonzero(state.x.data() + sparsity_[r].begin, needed);
      const T* gradient = gradient_at_all_sites(s, state.gradient) + field * scales_[s]->field_size();
      const std::size_t count = needed.size();
      std::vector<char> is_active(count, 0);
      for (std::uint32_t block : blocks.active()) is_active[block] = 1;
#pragma omp parallel for schedule(static)
      for (std::size_t block = 0; block < count; ++block)
        if (!needed[block] && (looks || is_active[block]))
          needed[block] = blocks.any_site(block, [&](std::size_t site) { return pull_at(r, site, gradient) > 1; });
    }
  }
}

/// Of the blocks of a scale.
template <int Dim, class T>
auto WorkingSet<Dim, T>::count_blocks(std::size_t scale, const std::vector<std::vector<char>>& wanted) const
    -> BlockCount {
  const FirstOrder& first = first_[scale];
  BlockCount count;
  std::size_t marked = 0;
  for (std::size_t r = first.range; r < first.range + first.fields; ++r) {
    count.all += wanted[r].size();
    count.active += blocks_[r].active().size();
    marked += static_cast<std::size_t>(std::count(wanted[r].begin(), wanted[r].end(), 1));
    for (std::uint32_t block : blocks_[r].active()) count.staying += wanted[r][block];
  }
  count.joining = marked - count.staying;
  count.is_full = count.joining > 0 && count.active + count.joining > most_active_ && sparsity_[first.range].weight > 0;
  return count;
}

/// Marks the blocks that have to be there: momenta that are, or were within the pairs, other than 0, and those that
/// want to be. Whether these are not the ones that are; blocks that may leave stay marked while they are few.
template <int Dim, class T>
bool WorkingSet<Dim, T>::wanted_blocks(MinimiserState<T>& state, std::vector<std::vector<char>>& wanted) {
  wanted.assign(blocks_.size(), {});
  mark_needed_blocks(state, wanted);
  const auto count_all = [&] {
    BlockCount sum;
    for (std::size_t s = 0; s < scales_.size(); ++s) sum += count_blocks(s, wanted);
    return sum;
  };
  // Where blocks are full those that are 0 and want to stay so make room.
  const auto may_leave = [](const BlockCount& count) { return count.is_full || 4 * count.idle() >= count.active; };
  BlockCount count = count_all();
  // Who is there within the pairs has reason to stay. That takes longest to find out, and mostly nobody may leave.
  bool shrinks = may_leave(count);
  if (shrinks) {
    for (std::size_t r = 0; r < blocks_.size(); ++r)
      for (const CurvaturePair<T>& pair : state.pairs)
        blocks_[r].mark_nonzero(pair.s.data() + sparsity_[r].begin, wanted[r]);
    std::size_t kept_out = 0;
    for (std::size_t s = 0; s < scales_.size(); ++s) {
      const BlockCount of_scale = count_blocks(s, wanted);
      if (of_scale.is_full && of_scale.staying + of_scale.joining > most_active_)
        kept_out += keep_out(s, most_active_ - std::min(most_active_, of_scale.staying), state.gradient, wanted);
    }
    if (kept_out > 0)
      kept_out_share_ = std::max(kept_out_share_, static_cast<double>(kept_out) / static_cast<double>(count.all));
    const bool was_full = count.is_full;
    count = count_all();
    count.is_full = was_full;
    shrinks = count.idle() > 0 && may_leave(count);
  }
  for (std::size_t r = 0; r < blocks_.size() && !shrinks; ++r)
    for (std::uint32_t block : blocks_[r].active()) wanted[r][block] = 1;
  return count.joining > 0 || shrinks;
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
template <class Value>
void WorkingSet<Dim, T>::reshape(const Layout& before, std::vector<Value>& values) const {
  std::vector<Value> now(size_);
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

/// Gradients of what has joined, from where the last evaluation left them. What was complete had them in the state.
template <int Dim, class T>
void WorkingSet<Dim, T>::fetch_gradients(const Layout& before, MinimiserState<T>& state) const {
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (int field = 0; field < first_[s].fields && !before.was_complete[s]; ++field) {
      const std::size_t r = first_[s].range + field;
      blocks_[r].gather(Dim, first_[s].gradient.data() + field * scales_[s]->field_size(),
                        state.gradient.data() + sparsity_[r].begin);
    }
}

namespace {

/// The share of those that are there now, and were not before; both rise.
double joined_share(const std::vector<std::uint32_t>& before, const std::vector<std::uint32_t>& now) {
  std::vector<std::uint32_t> joined;
  std::set_difference(now.begin(), now.end(), before.begin(), before.end(), std::back_inserter(joined));
  return now.empty() ? 0 : static_cast<double>(joined.size()) / static_cast<double>(now.size());
}

}  // namespace

template <int Dim, class T>
Revision WorkingSet<Dim, T>::revise(MinimiserState<T>& state) {
  std::vector<std::vector<char>> wanted;
  bool changes = wanted_blocks(state, wanted);
  std::vector<std::vector<std::uint32_t>> elements(scales_.size());
  for (std::size_t s = 0; s < scales_.size(); ++s)
    if (oriented_[s].momenta) elements[s] = wanted_elements(oriented_[s], state, changes);
  if (!changes) return {};

  Revision revision{true};
  const Layout before = layout();
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (std::size_t r = first_[s].range; r < first_[s].range + first_[s].fields; ++r) {
      std::vector<std::uint32_t> numbers;
      for (std::size_t block = 0; block < wanted[r].size(); ++block)
        if (wanted[r][block]) numbers.push_back(static_cast<std::uint32_t>(block));
      revision.joined = std::max(revision.joined, joined_share(blocks_[r].active(), numbers));
      if (numbers != blocks_[r].active()) blocks_[r] = BlockSet<Dim>(scales_[s]->lattice(), std::move(numbers));
    }
  std::vector<std::vector<std::uint32_t>> looked(scales_.size());  // lay_out forgets them
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    revision.joined = std::max(revision.joined, joined_share(oriented_[s].active, elements[s]));
    oriented_[s].active = std::move(elements[s]);
    looked[s] = oriented_[s].listed;
  }
  lay_out();
  gather_factors();

  reshape(before, state.x);  // what is preconditioned is of order 0, which stays
  reshape(before, state.gradient);
  for (CurvaturePair<T>& pair : state.pairs) {
    reshape(before, pair.s);
    reshape(before, pair.y);
  }
  fetch_gradients(before, state);
  for (FirstOrder& first : first_)
    if (has_all_blocks(first)) free_vector(first.gradient);  // from here on it is in the optimiser's vectors
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (looked[s].empty()) continue;
    pick_elements<Dim>(looked[s], oriented_[s].gradient.data(), oriented_[s].active,
                       state.gradient.data() + sparsity_[oriented_[s].range].begin);
  }
  return revision;
}

template <int Dim, class T>
bool WorkingSet<Dim, T>::would_join(std::vector<T>& gradient) {
  for (std::size_t s = 0; s < scales_.size(); ++s)
    for (int field = 0; field < first_[s].fields; ++field) {
      const std::size_t r = first_[s].range + field;
      const T* its = gradient_at_all_sites(s, gradient) + field * scales_[s]->field_size();
      for (std::size_t block = 0; block < blocks_[r].blocks(); ++block)
        if (blocks_[r].any_site(block, [&](std::size_t site) { return pull_at(r, site, its) > 1; })) return true;
    }
  return false;
}

#define SALTUS_REVISION(DIM, T)                                                          \
  template void WorkingSet<DIM, T>::list_candidates(std::size_t, const std::vector<T>&); \
  template Revision WorkingSet<DIM, T>::revise(MinimiserState<T>&);                      \
  template bool WorkingSet<DIM, T>::would_join(std::vector<T>&);
SALTUS_REVISION(2, float)
SALTUS_REVISION(3, float)
SALTUS_REVISION(2, double)
SALTUS_REVISION(3, double)
#undef SALTUS_REVISION

}  // namespace saltus
