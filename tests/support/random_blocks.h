#pragma once

#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "core/grid/block_mask.h"

namespace saltus::testing {

/// Each block with probability `share`; the same on every machine.
template <int Dim>
BlockMask<Dim> random_blocks(const Lattice<Dim>& lattice, std::uint64_t seed, double share) {
  auto mask = BlockMask<Dim>::none(lattice);
  std::size_t count = 1;
  for (int blocks : mask.blocks()) count *= static_cast<std::size_t>(blocks);
  std::mt19937_64 random(seed);
  for (std::size_t b = 0; b < count; ++b)
    if (static_cast<double>(random() >> 11) * 0x1p-53 < share) mask.mark(b);
  return mask;
}

/// By site: whether the mask has it.
template <int Dim>
std::vector<char> site_flags(const Lattice<Dim>& lattice, const BlockMask<Dim>& mask) {
  std::vector<char> flags(lattice.sites(), 0);
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      std::size_t block = 0, stride = 1;
      for (int axis = 0; axis < Dim; ++axis) {
        block += stride * static_cast<std::size_t>(index[axis] / kBlockEdge);
        stride *= static_cast<std::size_t>(mask.blocks()[axis]);
      }
      flags[site] = mask[block];
    });
  return flags;
}

/// The field, with `outside` where the mask has no site.
template <int Dim, class T>
std::vector<T> only_in(const Lattice<Dim>& lattice, const BlockMask<Dim>& mask, std::vector<T> field, T outside) {
  const std::vector<char> flags = site_flags<Dim>(lattice, mask);
  const std::size_t channels = field.size() / lattice.sites();
  for (std::size_t i = 0; i < field.size(); ++i)
    if (!flags[i / channels]) field[i] = outside;
  return field;
}

}  // namespace saltus::testing
