#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace saltus {

constexpr std::size_t kMiddleBlock = 1024;  ///< sites, of sums that are made apart

/// Of the weights and of both images, over `count` blocks, of which `block` tells the i-th.
template <class T, class Block>
std::array<double, 3> weighted_sums(std::size_t all_sites, const T* fixed, const T* warped, const T* weights,
                                    std::size_t count, const Block& block) {
  std::vector<std::array<double, 3>> partial(count);  // put together in the same order for any number of threads
#pragma omp parallel for schedule(static)
  for (std::size_t b = 0; b < count; ++b) {
    const std::size_t first = block(b) * kMiddleBlock, sites = std::min(kMiddleBlock, all_sites - first);
    const T *f = fixed + first, *w = warped + first, *weight = weights ? weights + first : nullptr;
    double all = 0, sum_f = 0, sum_w = 0;
    if (weight) {
#pragma omp simd reduction(+ : all, sum_f, sum_w)
      for (std::size_t i = 0; i < sites; ++i) {
        const double share = weight[i];
        all += share;
        sum_f += share > 0 ? share * double(f[i]) : 0.0;
        sum_w += share > 0 ? share * double(w[i]) : 0.0;
      }
    } else {
      all = static_cast<double>(sites);
#pragma omp simd reduction(+ : sum_f, sum_w)
      for (std::size_t i = 0; i < sites; ++i) {
        sum_f += double(f[i]);
        sum_w += double(w[i]);
      }
    }
    partial[b] = {all, sum_f, sum_w};
  }
  std::array<double, 3> sums{};
  for (const auto& part : partial)
    for (std::size_t k = 0; k < 3; ++k) sums[k] += part[k];
  return sums;
}

/// About those of both images, 0 when nothing is seen: any value near the mean keeps sums small, so of large images
/// one block in four is read, here and there, and all of them where those show nothing.
template <class T>
std::pair<T, T> middle_values(std::size_t sites, const T* fixed, const T* warped, const T* weights) {
  const std::size_t blocks = (sites + kMiddleBlock - 1) / kMiddleBlock;
  std::array<double, 3> sums{};
  if (blocks >= 64)
    sums = weighted_sums(sites, fixed, warped, weights, blocks / 4, [](std::size_t i) {
      return 4 * i + (static_cast<std::uint32_t>(i) * 2654435761u >> 30);  // not the same part of every row
    });
  if (!(sums[0] > 0)) sums = weighted_sums(sites, fixed, warped, weights, blocks, [](std::size_t i) { return i; });
  if (!(sums[0] > 0)) return {T(0), T(0)};
  return {static_cast<T>(sums[1] / sums[0]), static_cast<T>(sums[2] / sums[0])};
}

}  // namespace saltus
