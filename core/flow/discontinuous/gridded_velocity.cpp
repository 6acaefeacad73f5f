#include "core/flow/discontinuous/gridded_velocity.h"

#include "core/grid/interpolation.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

constexpr int kBlock = 8;   ///< samples along an axis of a block
constexpr int kMargin = 4;  ///< samples by which a sheet reaches into neighbouring blocks

}  // namespace

template <int Dim, class T>
GriddedVelocity<Dim, T>::GriddedVelocity(const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities,
                                         std::vector<SwitchingSheet<Dim>> sheets)
    : lattice_(lattice), velocities_(velocities), sheets_(std::move(sheets)) {
  std::size_t count = 1;
  for (int a = 0; a < Dim; ++a) {
    blocks_[a] = (lattice.size[a] + kBlock - 1) / kBlock;
    count *= static_cast<std::size_t>(blocks_[a]);
  }
  sheets_in_block_.resize(count);
  for (int s = 0; s < surfaces(); ++s) {
    const SwitchingSheet<Dim>& sheet = sheets_[s];
    Lattice<Dim> columns;
    columns.size = sheet.size;
    for (int slab = 0; slab < columns.size[Dim - 1]; ++slab)
      visit_slab<Dim>(columns, slab, [&](const Index<Dim>& index, std::size_t) {
        Index<Dim> at = index;
        for (int a = 0; a < Dim; ++a) at[a] += sheet.low[a];
        double least = 1e30, most = -1e30, covered = 0;
        for (int node = 0; node < static_cast<int>(sheet.nodes.size()); ++node) {
          const auto* column = sheet.column(node, at);
          if (!column->is_known) continue;
          covered = std::max(covered, double(column->coverage));
          least = std::min(least, double(column->height));
          most = std::max(most, double(column->height));
        }
        if (covered <= 0) return;
        Index<Dim> first, last;
        for (int a = 0; a < Dim; ++a) {
          const double low = a == sheet.axis ? (least - lattice_.offset[a]) / lattice_.spacing[a] : at[a];
          const double high = a == sheet.axis ? (most - lattice_.offset[a]) / lattice_.spacing[a] : at[a];
          first[a] = block(a, low - kMargin);
          last[a] = block(a, high + kMargin);
        }
        Index<Dim> b = first;
        for (bool more = true; more;) {
          std::size_t place = 0, stride = 1;
          for (int a = 0; a < Dim; ++a) {
            place += stride * static_cast<std::size_t>(b[a]);
            stride *= static_cast<std::size_t>(blocks_[a]);
          }
          std::vector<int>& list = sheets_in_block_[place];
          if (list.empty() || list.back() != s) list.push_back(s);
          int a = 0;
          while (a < Dim && ++b[a] > last[a]) b[a] = first[a], ++a;
          more = a < Dim;
        }
      });
  }
}

template <int Dim, class T>
int GriddedVelocity<Dim, T>::block(int axis, double coordinate) const {
  return static_cast<int>(std::clamp(coordinate, 0.0, double(lattice_.size[axis] - 1))) / kBlock;
}

template <int Dim, class T>
int GriddedVelocity<Dim, T>::node_before(double t, double& share) const {
  const int steps = static_cast<int>(velocities_.size()) - 1;
  const double at = t * steps;
  const int node = std::clamp(static_cast<int>(std::floor(at)), 0, steps - 1);
  share = at - node;
  return node;
}

template <int Dim, class T>
std::vector<double> GriddedVelocity<Dim, T>::time_breaks() const {
  std::vector<double> breaks;
  const int steps = static_cast<int>(velocities_.size()) - 1;
  for (int k = 0; k <= steps; ++k) breaks.push_back(double(k) / steps);
  return breaks;
}

template <int Dim, class T>
SurfaceJet<Dim> GriddedVelocity<Dim, T>::surface(int which, double t, const Vector<Dim>& x) const {
  double share;
  const int node = node_before(t, share);
  return sheets_[which].jet(node, share, 1.0 / (static_cast<double>(velocities_.size()) - 1), x);
}

template <int Dim, class T>
const std::vector<int>& GriddedVelocity<Dim, T>::sheets_about(const Vector<Dim>& x) const {
  std::size_t place = 0, stride = 1;
  for (int a = 0; a < Dim; ++a) {
    place += stride * static_cast<std::size_t>(block(a, (x[a] - lattice_.offset[a]) / lattice_.spacing[a]));
    stride *= static_cast<std::size_t>(blocks_[a]);
  }
  return sheets_in_block_[place];
}

template <int Dim, class T>
void GriddedVelocity<Dim, T>::surfaces_near(double, const Vector<Dim>& x, double reach, std::vector<int>& found) const {
  found.clear();
  if (sheets_.empty()) return;
  Index<Dim> first, last;
  for (int a = 0; a < Dim; ++a) {
    first[a] = block(a, (x[a] - reach - lattice_.offset[a]) / lattice_.spacing[a]);
    last[a] = block(a, (x[a] + reach - lattice_.offset[a]) / lattice_.spacing[a]);
  }
  Index<Dim> b = first;
  for (bool more = true; more;) {
    std::size_t place = 0, stride = 1;
    for (int a = 0; a < Dim; ++a) {
      place += stride * static_cast<std::size_t>(b[a]);
      stride *= static_cast<std::size_t>(blocks_[a]);
    }
    found.insert(found.end(), sheets_in_block_[place].begin(), sheets_in_block_[place].end());
    int a = 0;
    while (a < Dim && ++b[a] > last[a]) b[a] = first[a], ++a;
    more = a < Dim;
  }
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
}

template <int Dim, class T>
Vector<Dim> GriddedVelocity<Dim, T>::sample(int node, const Index<Dim>& index) const {
  std::size_t site = 0, stride = 1;
  for (int a = 0; a < Dim; ++a) {
    site += stride * static_cast<std::size_t>(index[a]);
    stride *= static_cast<std::size_t>(lattice_.size[a]);
  }
  Vector<Dim> value;
  for (int c = 0; c < Dim; ++c) value[c] = velocities_[node][Dim * site + c];
  return value;
}

template <int Dim, class T>
Vector<Dim> GriddedVelocity<Dim, T>::sample_of_side(int node, const Index<Dim>& index, const Sides& sides,
                                                    const std::vector<int>& near, int left_out, int depth) const {
  // Where sheets leave less than a sample between them no sample is clean, and after a few tries any will do.
  if (depth < 3)
    for (int s : near) {
      if (s == left_out || sides[s] == 0) continue;
      const SwitchingSheet<Dim>& sheet = sheets_[s];
      const auto* column = sheet.column(node, index);
      if (!column || !column->is_known || column->coverage < 0.5f) continue;
      const int a = sheet.axis, side = sides[s];
      const double clear = side * (index[a] - (column->height - lattice_.offset[a]) / lattice_.spacing[a]);
      if (clear >= sheet.clean_distance) continue;
      const int away = static_cast<int>(std::ceil(sheet.clean_distance - clear));
      Index<Dim> one = index, two = index;
      one[a] = std::clamp(index[a] + side * away, 0, lattice_.size[a] - 1);
      two[a] = std::clamp(one[a] + side, 0, lattice_.size[a] - 1);
      const Vector<Dim> nearest = sample_of_side(node, one, sides, near, s, depth + 1);
      if (two[a] == one[a] || std::abs(one[a] - index[a]) != away) return nearest;
      return nearest - away * (sample_of_side(node, two, sides, near, s, depth + 1) - nearest);
    }
  return sample(node, index);
}

template <int Dim, class T>
VelocityJet<Dim> GriddedVelocity<Dim, T>::velocity(double t, const Vector<Dim>& x, const Sides& sides) const {
  double share;
  const int node = node_before(t, share);
  std::array<double, Dim> at;
  for (int a = 0; a < Dim; ++a) at[a] = (x[a] - lattice_.offset[a]) / lattice_.spacing[a];
  const LinearCell<Dim, double> cell(lattice_, at);
  static const std::vector<int> none;
  const std::vector<int>& near = sheets_.empty() ? none : sheets_about(x);
  VelocityJet<Dim> found;
  for (int bits = 0; bits < LinearCell<Dim, double>::corners; ++bits) {
    Vector<Dim> value;
    if (near.empty()) {
      const std::size_t site = Dim * cell.corner(bits);
      for (int c = 0; c < Dim; ++c)
        value[c] = (1 - share) * velocities_[node][site + c] + share * velocities_[node + 1][site + c];
    } else {
      Index<Dim> index = cell.low;
      for (int a = 0; a < Dim; ++a) index[a] += (bits >> a & 1) && cell.step[a] ? 1 : 0;
      value = (1 - share) * sample_of_side(node, index, sides, near, -1, 0) +
              share * sample_of_side(node + 1, index, sides, near, -1, 0);
    }
    found.value += cell.weight(bits) * value;
    for (int a = 0; a < Dim; ++a) found.jacobian.col(a) += cell.weight_slope(bits, a) / lattice_.spacing[a] * value;
  }
  return found;
}

template class GriddedVelocity<2, float>;
template class GriddedVelocity<3, float>;
template class GriddedVelocity<2, double>;
template class GriddedVelocity<3, double>;

}  // namespace saltus
