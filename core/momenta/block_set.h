#pragma once

#include "core/grid/block_mask.h"
#include "core/grid/lattice.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace saltus {

/// Some of the blocks that a lattice is cut into (block_mask.h), to last. A *dense* field has values for all sites, a
/// *compact* one for the sites of active blocks only, in the order of the lattice (x fastest, over all active blocks),
/// so that with all blocks active the two are the same. Both are interleaved, with `channels` values a site.
template <int Dim>
class BlockSet {
 public:
  static constexpr int kEdge = kBlockEdge;

  /// All blocks of the lattice, or none of them.
  static BlockSet all(const Lattice<Dim>& lattice);
  static BlockSet none(const Lattice<Dim>& lattice) { return BlockSet(lattice, {}); }

  /// `active`: numbers of blocks, each once, rising. Throws InvalidInput when they are no such thing.
  BlockSet(const Lattice<Dim>& lattice, std::vector<std::uint32_t> active);

  std::size_t blocks() const { return blocks_; }  ///< that there are, active or not
  const std::vector<std::uint32_t>& active() const { return active_; }
  const BlockMask<Dim>& mask() const { return mask_; }
  bool is_complete() const { return active_.size() == blocks_; }
  std::size_t sites() const { return sites_; }          ///< of the active blocks
  std::size_t all_sites() const { return all_sites_; }  ///< of the lattice

  /// Dense -> compact.
  template <class T>
  void gather(int channels, const T* dense, T* compact) const;
  /// Compact -> dense; all other sites become 0.
  template <class T>
  void scatter(int channels, const T* compact, T* dense) const;
  /// The same, and all other sites stay as they are.
  template <class T>
  void scatter_within(int channels, const T* compact, T* dense) const;
  /// compact of `from` -> compact of this set, of the same lattice; sites that `from` does not have become 0.
  template <class T>
  void gather_from(const BlockSet& from, int channels, const T* theirs, T* compact) const;
  /// Sets found[block] of each active block in which the compact field of vectors has a value that is not 0; leaves the
  /// others.
  template <class T>
  void mark_nonzero(const T* compact, std::vector<char>& found) const;

  /// Calls visit(index, site) for the sites of active blocks in one slab of the last axis, in their order.
  template <class Visit>
  void visit_slab(int slab, Visit&& visit) const {
    const std::size_t plane = all_sites_ / static_cast<std::size_t>(size_[Dim - 1]), begin = plane * slab;
    const auto before = [](const Run& run, std::size_t site) { return run.site < site; };
    for (auto run = std::lower_bound(runs_.begin(), runs_.end(), begin, before);
         run != runs_.end() && run->site < begin + plane; ++run) {
      Index<Dim> index;
      std::size_t rest = run->site;
      for (int axis = 0; axis < Dim; ++axis) {
        index[axis] = static_cast<int>(rest % static_cast<std::size_t>(size_[axis]));
        rest /= static_cast<std::size_t>(size_[axis]);
      }
      for (std::size_t site = run->site; site < run->site + run->count; ++site, ++index[0]) visit(index, site);
    }
  }

  /// Whether condition(site) holds for some site of the block.
  template <class Condition>
  bool any_site(std::size_t block, Condition&& condition) const {
    Index<Dim> first, end;
    std::size_t rest = block, start = 0, stride = 1;
    std::size_t strides[Dim];
    for (int axis = 0; axis < Dim; ++axis) {
      const std::size_t along = blocks_along(axis);
      first[axis] = static_cast<int>(rest % along) * kEdge;
      end[axis] = first[axis] + kEdge < size_[axis] ? first[axis] + kEdge : size_[axis];
      rest /= along;
      strides[axis] = stride;
      start += stride * static_cast<std::size_t>(first[axis]);
      stride *= static_cast<std::size_t>(size_[axis]);
    }
    const int planes = Dim == 3 ? end[Dim - 1] - first[Dim - 1] : 1;
    for (int z = 0; z < planes; ++z)
      for (int y = 0; y < end[1] - first[1]; ++y)
        for (int x = 0; x < end[0] - first[0]; ++x)
          if (condition(start + z * strides[Dim - 1] + y * strides[1] + x)) return true;
    return false;
  }

 private:
  /// Neighbouring active blocks cut by one row of the lattice: sites that follow each other in both orders.
  struct Run {
    std::size_t site, at, count;  ///< first site, its place in the compact order, number of sites
    std::size_t block;            ///< of the first site
  };
  std::size_t blocks_along(int axis) const { return static_cast<std::size_t>((size_[axis] + kEdge - 1) / kEdge); }

  Index<Dim> size_;
  std::size_t blocks_ = 1, sites_ = 0, all_sites_ = 1;
  std::vector<std::uint32_t> active_;
  BlockMask<Dim> mask_;
  std::vector<Run> runs_;
};

/// The blocks of each first-order field m_i that count, by axis i; null: the whole field.
template <int Dim>
using AxisBlocks = std::array<const BlockSet<Dim>*, Dim>;

/// Their masks; `lattice` is the one of the fields.
template <int Dim>
std::array<BlockMask<Dim>, Dim> masks_of(const Lattice<Dim>& lattice, const AxisBlocks<Dim>& blocks) {
  const auto mask = [&](int axis) { return blocks[axis] ? blocks[axis]->mask() : BlockMask<Dim>::all(lattice); };
  if constexpr (Dim == 2)
    return {mask(0), mask(1)};
  else
    return {mask(0), mask(1), mask(2)};
}

/// Where the fields of one scale's momenta are worth anything.
template <int Dim>
struct MomentumMasks {
  BlockMask<Dim> zeroth;
  std::array<BlockMask<Dim>, Dim> first;

  /// The same for all axes.
  MomentumMasks(const BlockMask<Dim>& zeroth, const BlockMask<Dim>& each_first)
      : MomentumMasks(zeroth, each_first, std::make_index_sequence<Dim>()) {}

  bool is_empty() const { return zeroth.is_empty() && has_no_first(); }
  bool has_no_first() const {
    return std::all_of(first.begin(), first.end(), [](const BlockMask<Dim>& mask) { return mask.is_empty(); });
  }

 private:
  template <std::size_t... Axis>
  MomentumMasks(const BlockMask<Dim>& zeroth, const BlockMask<Dim>& each_first, std::index_sequence<Axis...>)
      : zeroth(zeroth), first{(static_cast<void>(Axis), each_first)...} {}
};

}  // namespace saltus
