#include "core/evaluation/label_overlap.h"

#include <cmath>
#include <map>

#include "core/evaluation/grid_agreement.h"
#include "core/support/errors.h"

namespace saltus {

template <int Dim>
std::vector<LabelOverlap> label_overlaps(const Volume<Dim>& a, const Volume<Dim>& b) {
  require_same_grid("the first label image", a.grid, "the second", b.grid);
  struct Counts {
    std::size_t a = 0, b = 0, both = 0;
  };
  std::map<long, Counts> counts;
  for (std::size_t voxel = 0; voxel < a.samples.size(); ++voxel) {
    const long label_a = std::lround(a.samples[voxel]), label_b = std::lround(b.samples[voxel]);
    if (label_a != 0) ++counts[label_a].a;
    if (label_b != 0) ++counts[label_b].b;
    if (label_a != 0 && label_a == label_b) ++counts[label_a].both;
  }
  if (counts.empty()) throw InvalidInput("the label images are 0 everywhere; at least one label is needed.");
  std::vector<LabelOverlap> overlaps;
  for (const auto& [label, count] : counts)
    overlaps.push_back({static_cast<int>(label), count.a, count.b,
                        2.0 * static_cast<double>(count.both) / static_cast<double>(count.a + count.b)});
  return overlaps;
}

template std::vector<LabelOverlap> label_overlaps(const Volume<2>&, const Volume<2>&);
template std::vector<LabelOverlap> label_overlaps(const Volume<3>&, const Volume<3>&);

}  // namespace saltus
