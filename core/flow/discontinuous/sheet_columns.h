#pragma once

#include "core/flow/discontinuous/switching_sheet.h"

#include <array>
#include <vector>

namespace saltus {

/// Columns by which heights go on past a sheet's rim, so that motion in time and slopes have both ends there.
constexpr int kSheetRings = 4;

/// Gives a sheet the columns between the lattice coordinates `least` and `most` of its surface at all nodes, and
/// kSheetRings more on each side as far as the lattice goes. `axis` and `lattice` must be set.
template <int Dim>
void span_columns(SwitchingSheet<Dim>& sheet, const Vector<Dim>& least, const Vector<Dim>& most);

/// Makes the columns of a sheet at one node from points on its surface.
template <int Dim>
class SheetColumns {
 public:
  /// `sheet` has its columns (span_columns) and must outlive this.
  explicit SheetColumns(const SwitchingSheet<Dim>& sheet);

  /// Adds a point of the surface: its height along the sheet's axis in mm, its place in lattice coordinates (entry
  /// `axis` is not read), and how much of a column it covers. What lies beyond the columns is left out.
  void add(double height, const Vector<Dim>& coordinates, double share);

  /// The mean height of each column that got more than `least` of coverage, then kSheetRings rings of columns around
  /// them with heights but no coverage.
  std::vector<typename SwitchingSheet<Dim>::Column> columns(double least) const;

 private:
  const SwitchingSheet<Dim>& sheet_;
  std::array<std::size_t, Dim> stride_{};
  std::vector<double> weight_, sum_;
};

}  // namespace saltus
