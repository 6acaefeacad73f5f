#pragma once

#include <cstddef>
#include <vector>

namespace saltus {

/// How a row of taps relates to its mirror image.
enum class Mirror {
  Even,  ///< tap t is tap c - t
  Odd    ///< tap t is minus tap c - t
};

/// A row of taps that is its own mirror image, up to the sign: about tap 0 (c = 0), or about the middle between tap 0
/// and one of its neighbours (c = 1 or -1), as rows between samples and the faces between them are. It makes of values
/// v
///     middle v[i] + sum over k of sides[k] (v[i - before - k] +- v[i + after + k]).
template <class T>
struct MirroredTaps {
  Mirror kind = Mirror::Even;
  int before = 1, after = 1;  ///< the nearest of either side: (1, 1), (1, 0) for c = 1, or (0, 1) for c = -1
  T middle = 0;               ///< 0 unless the row is even about tap 0
  std::vector<T> sides;

  std::size_t reach() const { return sides.size(); }  ///< how far the last value on either side is, at most
};

/// A row of taps for t = -radius..radius, ready to be applied along an axis: as the rows that are their own mirror
/// images whose sum it is. Those of kernels and their derivatives are one such row to the last bit (but for slopes of a
/// kernel that is cut), others two. Taps are finite, and their number is odd.
template <class T>
class AxisTaps {
 public:
  explicit AxisTaps(const std::vector<double>& taps);

  int radius() const { return radius_; }
  const std::vector<MirroredTaps<T>>& parts() const { return parts_; }

 private:
  int radius_;
  std::vector<MirroredTaps<T>> parts_;
};

std::vector<double> scaled(std::vector<double> taps, double factor);

/// The row of the transposed convolution: tap t is the old tap -t.
std::vector<double> reversed(const std::vector<double>& taps);

}  // namespace saltus
