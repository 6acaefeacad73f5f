#pragma once

#include "core/grid/volume.h"

#include <array>
#include <string>

namespace saltus::report {

/// SVG paths of what slides, coloured from 0 to a largest slip as `interface_colour`: one path for each of a few
/// classes of slip, so that a page does not carry a colour for each of a thousand pieces. Points are pixels of a
/// picture.
class SlipPaths {
 public:
  explicit SlipPaths(double most_mm) : most_mm_(most_mm) {}

  void add_line(double slip_mm, const Vector<2>& from, const Vector<2>& to);
  /// By opposite corners.
  void add_rectangle(double slip_mm, const Vector<2>& one, const Vector<2>& other);

  /// All paths; areas have the class "face".
  std::string text() const;

 private:
  static constexpr std::size_t kClasses = 12;
  std::size_t class_of(double slip_mm) const;

  double most_mm_;
  std::array<std::string, kClasses> lines_, areas_;
};

}  // namespace saltus::report
