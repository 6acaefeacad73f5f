#include "core/flow/discontinuous/sheet_columns.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
void span_columns(SwitchingSheet<Dim>& sheet, const Vector<Dim>& least, const Vector<Dim>& most) {
  for (int a = 0; a < Dim; ++a) {
    const int low = std::max(0, static_cast<int>(std::floor(least[a])) - kSheetRings);
    const int high = std::min(sheet.lattice.size[a] - 1, static_cast<int>(std::ceil(most[a])) + kSheetRings);
    sheet.low[a] = a == sheet.axis ? 0 : low;
    sheet.size[a] = a == sheet.axis ? 1 : std::max(1, high - low + 1);
  }
}

template <int Dim>
SheetColumns<Dim>::SheetColumns(const SwitchingSheet<Dim>& sheet) : sheet_(sheet) {
  std::size_t columns = 1;
  for (int a = 0; a < Dim; ++a) {
    stride_[a] = columns;
    columns *= static_cast<std::size_t>(sheet.size[a]);
  }
  weight_.assign(columns, 0.0);
  sum_.assign(columns, 0.0);
}

template <int Dim>
void SheetColumns<Dim>::add(double height, const Vector<Dim>& coordinates, double share) {
  for (int bits = 0; bits < 1 << Dim; ++bits) {
    if (bits >> sheet_.axis & 1) continue;
    double weight = share;
    std::size_t column = 0;
    bool is_inside = true;
    for (int a = 0; a < Dim; ++a) {
      if (a == sheet_.axis) continue;
      const double at = coordinates[a] - sheet_.low[a];
      const double cell = std::floor(at) + (bits >> a & 1);
      weight *= 1 - std::abs(at - cell);
      is_inside = is_inside && cell >= 0 && cell < sheet_.size[a];
      if (is_inside) column += stride_[a] * static_cast<std::size_t>(cell);
    }
    if (!is_inside || weight <= 0) continue;
    weight_[column] += weight;
    sum_[column] += weight * height;
  }
}

template <int Dim>
std::vector<typename SwitchingSheet<Dim>::Column> SheetColumns<Dim>::columns(double least) const {
  std::vector<typename SwitchingSheet<Dim>::Column> found(weight_.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    if (weight_[i] > least)
      found[i] = {static_cast<float>(sum_[i] / weight_[i]), static_cast<float>(std::min(1.0, weight_[i])), true};
  for (int ring = 0; ring < kSheetRings; ++ring) {
    const auto before = found;
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (before[i].is_known) continue;
      double total = 0;
      int count = 0;
      for (int a = 0; a < Dim; ++a) {
        if (a == sheet_.axis) continue;
        const auto length = static_cast<std::size_t>(sheet_.size[a]);
        const std::size_t along = i / stride_[a] % length;
        if (along > 0 && before[i - stride_[a]].is_known) total += before[i - stride_[a]].height, ++count;
        if (along + 1 < length && before[i + stride_[a]].is_known) total += before[i + stride_[a]].height, ++count;
      }
      if (count) found[i] = {static_cast<float>(total / count), 0.0f, true};
    }
  }
  return found;
}

template void span_columns(SwitchingSheet<2>&, const Vector<2>&, const Vector<2>&);
template void span_columns(SwitchingSheet<3>&, const Vector<3>&, const Vector<3>&);
template class SheetColumns<2>;
template class SheetColumns<3>;

}  // namespace saltus
