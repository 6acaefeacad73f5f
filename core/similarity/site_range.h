#pragma once

#include <algorithm>

namespace saltus {

/// Of sites, rows or planes along an axis, the end excluded.
struct SiteRange {
  int begin = 0, end = 0;
  bool holds(int i) const { return begin <= i && i < end; }
  SiteRange grown(int by, int size) const { return {std::max(0, begin - by), std::min(size, end + by)}; }
  int count() const { return end - begin; }
};

}  // namespace saltus
