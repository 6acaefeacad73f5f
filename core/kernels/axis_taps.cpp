#include "core/kernels/axis_taps.h"

#include <optional>

namespace saltus {
namespace {

/// The row as its own mirror image about c / 2; none where it is not.
template <class T>
std::optional<MirroredTaps<T>> mirrored(const std::vector<double>& taps, Mirror kind, int c) {
  const int radius = static_cast<int>(taps.size() / 2);
  const auto tap = [&](int t) {
    return t < -radius || t > radius ? T(0) : static_cast<T>(taps[static_cast<std::size_t>(t + radius)]);
  };
  const T sign = kind == Mirror::Even ? T(1) : T(-1);
  for (int t = -radius; t <= radius; ++t)
    if (tap(t) != sign * tap(c - t)) return std::nullopt;
  MirroredTaps<T> row;
  row.kind = kind;
  row.before = c < 0 ? 0 : 1;
  row.after = row.before - c;
  if (c == 0) row.middle = tap(0);
  // Taps further out on either side are 0: what mirrors them is beyond the row.
  for (int t = row.before; t <= radius && row.after + t - row.before <= radius; ++t) row.sides.push_back(tap(t));
  return row;
}

}  // namespace

template <class T>
AxisTaps<T>::AxisTaps(const std::vector<double>& taps) : radius_(static_cast<int>(taps.size() / 2)) {
  for (Mirror kind : {Mirror::Even, Mirror::Odd})
    for (int c : {0, 1, -1})
      if (std::optional<MirroredTaps<T>> row = mirrored<T>(taps, kind, c)) {
        parts_ = {std::move(*row)};
        return;
      }
  const std::vector<double> mirror = reversed(taps);
  std::vector<double> even, odd;
  for (std::size_t i = 0; i < taps.size(); ++i) {
    even.push_back((taps[i] + mirror[i]) / 2);
    odd.push_back((taps[i] - mirror[i]) / 2);
  }
  parts_ = {mirrored<T>(even, Mirror::Even, 0).value(), mirrored<T>(odd, Mirror::Odd, 0).value()};
}

std::vector<double> scaled(std::vector<double> taps, double factor) {
  for (double& tap : taps) tap *= factor;
  return taps;
}

std::vector<double> reversed(const std::vector<double>& taps) { return {taps.rbegin(), taps.rend()}; }

template class AxisTaps<float>;
template class AxisTaps<double>;

}  // namespace saltus
