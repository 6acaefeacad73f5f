#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace saltus {

/// Calls visit(bytes) with samples that lie component after component, those of a voxel next to each other, some voxels
/// at a time.
template <typename Sample, typename Visit>
void for_interleaved(std::span<const Sample> samples, std::size_t components, Visit&& visit) {
  constexpr std::size_t most = std::size_t{1} << 14;
  const std::size_t voxels = samples.size() / components;
  std::vector<Sample> some(components * std::min(most, voxels));
  for (std::size_t begin = 0; begin < voxels; begin += most) {
    const std::size_t count = std::min(most, voxels - begin);
    for (std::size_t c = 0; c < components; ++c)
      for (std::size_t i = 0; i < count; ++i) some[i * components + c] = samples[c * voxels + begin + i];
    visit(std::span<const char>(reinterpret_cast<const char*>(some.data()), sizeof(Sample) * components * count));
  }
}

}  // namespace saltus
