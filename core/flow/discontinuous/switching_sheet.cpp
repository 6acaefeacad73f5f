#include "core/flow/discontinuous/switching_sheet.h"

#include "core/flow/discontinuous/sheet_columns.h"
#include "core/flow/particle_steps.h"
#include "core/kernels/separable_convolution.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
std::size_t SwitchingSheet<Dim>::place(const Index<Dim>& index) const {
  std::size_t at = 0, stride = 1;
  for (int a = 0; a < Dim; ++a) {
    if (a == axis) continue;
    at += stride * static_cast<std::size_t>(index[a] - low[a]);
    stride *= static_cast<std::size_t>(size[a]);
  }
  return at;
}

template <int Dim>
auto SwitchingSheet<Dim>::column(int node, const Index<Dim>& index) const -> const Column* {
  for (int a = 0; a < Dim; ++a)
    if (a != axis && (index[a] < low[a] || index[a] >= low[a] + size[a])) return nullptr;
  return &nodes[node][place(index)];
}

template <int Dim>
SurfaceJet<Dim> SwitchingSheet<Dim>::jet(int node, double share, double node_spacing, const Vector<Dim>& x) const {
  SurfaceJet<Dim> found;
  found.exists = false;
  Index<Dim> cell{};
  Vector<Dim> fraction = Vector<Dim>::Zero();
  for (int a = 0; a < Dim; ++a) {
    if (a == axis) continue;
    const double at = (x[a] - lattice.offset[a]) / lattice.spacing[a];
    if (!(at >= low[a] - 1 && at <= low[a] + size[a])) return found;
    cell[a] = static_cast<int>(std::floor(at));
    fraction[a] = at - cell[a];
  }
  double height = 0, rise = 0, coverage = 0;
  Vector<Dim> slope = Vector<Dim>::Zero(), slope_rise = Vector<Dim>::Zero();
  Matrix<Dim> bend = Matrix<Dim>::Zero();
  for (int bits = 0; bits < 1 << Dim; ++bits) {
    if (bits >> axis & 1) continue;
    Index<Dim> index = cell;
    double weight = 1;
    for (int a = 0; a < Dim; ++a) {
      if (a == axis) continue;
      index[a] += bits >> a & 1;
      weight *= bits >> a & 1 ? fraction[a] : 1 - fraction[a];
    }
    const Column *now = column(node, index), *next = column(node + 1, index);
    if (!now || !next || !now->is_known || !next->is_known) {
      if (weight > 1e-12) return found;
      continue;
    }
    const double here = (1 - share) * now->height + share * next->height;
    const double rate = (next->height - now->height) / node_spacing;
    height += weight * here;
    rise += weight * rate;
    coverage += weight * ((1 - share) * now->coverage + share * next->coverage);
    for (int a = 0; a < Dim; ++a) {
      if (a == axis) continue;
      double along = (bits >> a & 1 ? 1 : -1) / lattice.spacing[a];
      for (int b = 0; b < Dim; ++b)
        if (b != axis && b != a) {
          bend(a, b) += along * (bits >> b & 1 ? 1 : -1) / lattice.spacing[b] * here;
          along *= bits >> b & 1 ? fraction[b] : 1 - fraction[b];
        }
      slope[a] += along * here;
      slope_rise[a] += along * rate;
    }
  }
  if (coverage < 0.5) return found;
  found.exists = true;
  found.value = x[axis] - height;
  found.gradient = Vector<Dim>::Unit(axis) - slope;
  found.rate = -rise;
  found.hessian = -bend;
  found.rate_gradient = -slope_rise;
  return found;
}

namespace {

bool jumps(const KernelSum& kernel) {
  const double near = 1e-4;
  return std::any_of(kernel.components().begin(), kernel.components().end(), [&](const KernelComponent& component) {
    const KernelProfile& k0 = *component.profile;
    return 1 - k0.value(near * k0.width()) > 0.1 * near;  // a smooth k0 falls quadratically
  });
}

template <int Dim>
struct Faces {
  int axis;
  std::vector<Index<Dim>> members;
};

/// Faces with a large jump along one axis, sorted into sheets.
template <int Dim, class T>
void gather_sheets(const MomentumScale<Dim, T>& scale, const T* momentum, int axis, double least,
                   std::vector<Faces<Dim>>& sheets) {
  const Lattice<Dim>& lattice = scale.lattice();
  std::array<std::size_t, Dim> stride;
  std::size_t sites = 1;
  for (int a = 0; a < Dim; ++a) {
    stride[a] = sites;
    sites *= static_cast<std::size_t>(lattice.size[a]);
  }
  // The jump across a face: momenta smoothed along the other axes, times what a unit sheet jumps by.
  Field<T> jump(scale.field_size(), T(0)), smoothed(jump.size()), next(jump.size());
  for (const KernelComponent& component : scale.options().kernel.components()) {
    const KernelProfile& kernel = *component.profile;
    std::copy_n(momentum, smoothed.size(), smoothed.begin());
    for (int a = 0; a < Dim; ++a) {
      if (a == axis) continue;
      const AxisTaps<T> taps(cell_averaged_taps(kernel, lattice.spacing[a]).value);
      convolve_axis<Dim, T>(lattice, Dim, a, taps, Combine::Replace, smoothed.data(), next.data());
      std::swap(smoothed, next);
    }
    const double factor = component.weight * scale.options().first_weight * scale.options().kernel.width() /
                          kernel.mass() * 2 * std::abs(kernel.value(lattice.spacing[axis]) - kernel.value(0));
    for (std::size_t i = 0; i < jump.size(); ++i) jump[i] += static_cast<T>(factor) * smoothed[i];
  }
  std::vector<char> open(sites, 0);
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      double square = 0;
      for (int c = 0; c < Dim; ++c) square += double(jump[Dim * site + c]) * jump[Dim * site + c];
      open[site] = index[axis] + 1 < lattice.size[axis] && std::sqrt(square) >= least;
    });
  std::vector<int> owner(sites / static_cast<std::size_t>(lattice.size[axis]), -1);  // last sheet over a column
  const auto column_of = [&](std::size_t site) {
    return site % stride[axis] + site / (stride[axis] * lattice.size[axis]) * stride[axis];
  };
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      if (!open[site]) return;
      const int label = static_cast<int>(sheets.size());
      sheets.push_back({axis, {index}});
      open[site] = 0;
      owner[column_of(site)] = label;
      for (std::size_t i = 0; i < sheets.back().members.size(); ++i) {
        const Index<Dim> from = sheets.back().members[i];
        for (int a = 0; a < Dim; ++a)
          for (int side = -1; side <= 1 && a != axis; side += 2)
            for (int up : {0, -1, 1}) {
              Index<Dim> to = from;
              to[a] += side;
              to[axis] += up;
              if (to[a] < 0 || to[a] >= lattice.size[a] || to[axis] < 0 || to[axis] >= lattice.size[axis]) continue;
              std::size_t at = 0;
              for (int b = 0; b < Dim; ++b) at += stride[b] * static_cast<std::size_t>(to[b]);
              if (!open[at] || owner[column_of(at)] == label) continue;
              open[at] = 0;
              owner[column_of(at)] = label;
              sheets.back().members.push_back(to);
            }
      }
    });
}

/// Columns that the moved faces cover at one node.
template <int Dim, class T>
std::vector<typename SwitchingSheet<Dim>::Column> cover(const SwitchingSheet<Dim>& sheet, const Faces<Dim>& faces,
                                                        const T* displacement) {
  const Lattice<Dim>& lattice = sheet.lattice;
  std::array<std::size_t, Dim> stride;
  std::size_t sites = 1;
  for (int a = 0; a < Dim; ++a) {
    stride[a] = sites;
    sites *= static_cast<std::size_t>(lattice.size[a]);
  }
  SheetColumns<Dim> columns(sheet);
  for (const Index<Dim>& face : faces.members) {
    std::size_t site = 0;
    for (int a = 0; a < Dim; ++a) site += stride[a] * static_cast<std::size_t>(face[a]);
    Vector<Dim> moved, coordinates;
    for (int a = 0; a < Dim; ++a) {
      moved[a] =
          displacement
              ? 0.5 * (double(displacement[Dim * site + a]) + displacement[Dim * (site + stride[sheet.axis]) + a])
              : 0.0;
      coordinates[a] = face[a] + moved[a] / lattice.spacing[a];
    }
    const double height =
        (face[sheet.axis] + 0.5) * lattice.spacing[sheet.axis] + lattice.offset[sheet.axis] + moved[sheet.axis];
    columns.add(height, coordinates, 1);
  }
  return columns.columns(1e-6);
}

}  // namespace

template <int Dim, class T>
std::vector<SwitchingSheet<Dim>> find_switching_sheets(const MomentumScale<Dim, T>& scale, const T* first,
                                                       const Lattice<Dim>& velocity_lattice,
                                                       const std::vector<Field<T>>& velocities,
                                                       const SwitchingSheetOptions& options) {
  if (!first || !(scale.lattice() == velocity_lattice) || !jumps(scale.options().kernel)) return {};
  const Lattice<Dim>& lattice = velocity_lattice;
  std::vector<Faces<Dim>> faces;
  for (int axis = 0; axis < Dim; ++axis)
    gather_sheets<Dim, T>(scale, first + static_cast<std::size_t>(axis) * scale.field_size(), axis,
                          options.least_jump_samples * lattice.spacing[axis], faces);
  if (faces.empty()) return {};

  // Places of the sites at the nodes, as in GeodesicShooting: momenta of node k lie at the predicted places.
  const int steps = static_cast<int>(velocities.size()) - 1;
  const T dt = T(1) / static_cast<T>(steps);
  std::vector<Field<T>> places(velocities.size());
  Field<T> position(velocities[0].size(), T(0));
  for (int k = 0; k < steps; ++k) {
    places[k + 1].resize(position.size());
    advance<Dim, T>(lattice, position.data(), position.data(), lattice, velocities[k].data(), dt, places[k + 1].data());
    if (k + 1 == steps) break;
    advance<Dim, T>(lattice, position.data(), position.data(), lattice, velocities[k].data(), dt / 2, position.data());
    advance<Dim, T>(lattice, position.data(), places[k + 1].data(), lattice, velocities[k + 1].data(), dt / 2,
                    position.data());
  }

  std::vector<SwitchingSheet<Dim>> sheets(faces.size());
#pragma omp parallel for schedule(dynamic)
  for (std::size_t s = 0; s < faces.size(); ++s) {
    SwitchingSheet<Dim>& sheet = sheets[s];
    sheet.axis = faces[s].axis;
    sheet.lattice = lattice;
    Vector<Dim> least = Vector<Dim>::Constant(1e30), most = -least;
    for (const Index<Dim>& face : faces[s].members) {
      std::size_t site = 0, stride = 1;
      for (int a = 0; a < Dim; ++a) {
        site += stride * static_cast<std::size_t>(face[a]);
        stride *= static_cast<std::size_t>(lattice.size[a]);
      }
      for (int a = 0; a < Dim; ++a)
        for (const Field<T>& place : places) {
          const double at = face[a] + (place.empty() ? 0.0 : place[Dim * site + a] / lattice.spacing[a]);
          least[a] = std::min(least[a], at);
          most[a] = std::max(most[a], at);
        }
    }
    span_columns(sheet, least, most);
    for (const Field<T>& place : places)
      sheet.nodes.push_back(cover<Dim, T>(sheet, faces[s], place.empty() ? nullptr : place.data()));
  }
  return sheets;
}

#define SALTUS_SHEETS(DIM, T)                                                                                        \
  template std::vector<SwitchingSheet<DIM>> find_switching_sheets(const MomentumScale<DIM, T>&, const T*,            \
                                                                  const Lattice<DIM>&, const std::vector<Field<T>>&, \
                                                                  const SwitchingSheetOptions&);
template class SwitchingSheet<2>;
template class SwitchingSheet<3>;
SALTUS_SHEETS(2, float)
SALTUS_SHEETS(3, float)
SALTUS_SHEETS(2, double)
SALTUS_SHEETS(3, double)
#undef SALTUS_SHEETS

}  // namespace saltus
