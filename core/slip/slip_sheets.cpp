#include "core/slip/slip_sheets.h"

#include "core/flow/discontinuous/sheet_columns.h"
#include "core/flow/point_steps.h"
#include "core/slip/ridge_mesh.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace saltus {
namespace {

constexpr double kObliqueCleanDistance = 2.5;

/// Cosine between a chart's axis and the normals of its facets, in samples: charts overlap nowhere, and a surface that
/// runs between two axes is not cut to pieces.
constexpr double kLeastUpright = 0.6;

/// Facets that hang together and can be seen along one axis.
struct Chart {
  int axis = 0;
  std::vector<std::size_t> facets;
};

template <int Dim>
std::vector<Chart> charts_of(const RidgeMesh<Dim>& mesh, const Lattice<Dim>& lattice, const std::vector<char>& jumps) {
  std::vector<Vector<Dim>> normals(mesh.facets.size(), Vector<Dim>::Zero());
  std::vector<std::vector<std::size_t>> at_vertex(mesh.vertices.size());
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    if (!jumps[f]) continue;
    normals[f] = area_vector(mesh, mesh.facets[f]);
    for (int a = 0; a < Dim; ++a) normals[f][a] *= lattice.spacing[a];
    normals[f].normalize();
    for (int corner : mesh.facets[f].corners) at_vertex[static_cast<std::size_t>(corner)].push_back(f);
  }
  std::vector<Chart> charts;
  std::vector<char> is_taken(mesh.facets.size(), 0);
  for (std::size_t seed = 0; seed < mesh.facets.size(); ++seed) {
    if (is_taken[seed] || !jumps[seed]) continue;
    Eigen::Index upright = 0;
    normals[seed].cwiseAbs().maxCoeff(&upright);
    charts.push_back({static_cast<int>(upright), {seed}});
    is_taken[seed] = 1;
    std::vector<std::size_t>& members = charts.back().facets;
    for (std::size_t i = 0; i < members.size(); ++i)
      for (int corner : mesh.facets[members[i]].corners)
        for (std::size_t other : at_vertex[static_cast<std::size_t>(corner)])
          if (!is_taken[other] && std::abs(normals[other][upright]) > kLeastUpright) {
            is_taken[other] = 1;
            members.push_back(other);
          }
  }
  return charts;
}

/// Heights of a chart over the sheet's columns, from points spread evenly over its facets.
template <int Dim>
std::vector<typename SwitchingSheet<Dim>::Column> cover(const SwitchingSheet<Dim>& sheet, const RidgeMesh<Dim>& mesh,
                                                        const Chart& chart) {
  constexpr int parts = 4;  // of a facet's side
  const Lattice<Dim>& lattice = sheet.lattice;
  double column_area = 1;
  for (int a = 0; a < Dim; ++a)
    if (a != sheet.axis) column_area *= lattice.spacing[a];
  SheetColumns<Dim> columns(sheet);
  const auto add = [&](const Vector<Dim>& at, double share) {
    Vector<Dim> coordinates;
    for (int a = 0; a < Dim; ++a) coordinates[a] = (at[a] - lattice.offset[a]) / lattice.spacing[a];
    columns.add(at[sheet.axis], coordinates, share);
  };
  for (std::size_t f : chart.facets) {
    const auto& facet = mesh.facets[f];
    const auto corner = [&](int k) { return mesh.vertices[static_cast<std::size_t>(facet.corners[k])]; };
    const double share = std::abs(area_vector(mesh, facet)[sheet.axis]) / column_area;
    if constexpr (Dim == 2) {
      for (int i = 0; i < parts; ++i) add(corner(0) + (i + 0.5) / parts * (corner(1) - corner(0)), share / parts);
    } else {
      // A triangle is parts^2 triangles, each with its middle.
      for (int i = 0; i < parts; ++i)
        for (int j = 0; i + j < parts; ++j)
          for (int up = 0; up < (i + j + 1 < parts ? 2 : 1); ++up) {
            const double u = (i + (up ? 2.0 : 1.0) / 3) / parts, v = (j + (up ? 2.0 : 1.0) / 3) / parts;
            add(corner(0) + u * (corner(1) - corner(0)) + v * (corner(2) - corner(0)), share / (parts * parts));
          }
    }
  }
  return columns.columns(1e-3);
}

/// Vertices at the nodes of the flow.
template <int Dim>
std::vector<std::vector<float>> paths_of(const RidgeMesh<Dim>& mesh, const Lattice<Dim>& lattice,
                                         const std::vector<Field<float>>& velocities) {
  std::vector<std::vector<float>> places(velocities.size());
  for (const Vector<Dim>& vertex : mesh.vertices)
    for (int a = 0; a < Dim; ++a) places[0].push_back(static_cast<float>(vertex[a]));
  const float dt = 1.0f / static_cast<float>(velocities.size() - 1);
  std::vector<float> predicted(places[0].size());
  for (std::size_t k = 0; k + 1 < velocities.size(); ++k) {
    places[k + 1].resize(places[0].size());
    advance_points<Dim, float>(places[k], places[k], lattice, velocities[k].data(), dt, predicted);
    advance_points<Dim, float>(places[k], places[k], lattice, velocities[k].data(), dt / 2, places[k + 1]);
    advance_points<Dim, float>(places[k + 1], predicted, lattice, velocities[k + 1].data(), dt / 2, places[k + 1]);
  }
  return places;
}

}  // namespace

template <int Dim>
std::vector<SwitchingSheet<Dim>> slip_sheets(const std::vector<JumpElements<Dim>>& elements,
                                             const Lattice<Dim>& lattice, const std::vector<Field<float>>& velocities,
                                             const SwitchingSheetOptions& options) {
  if (std::all_of(elements.begin(), elements.end(), [](const auto& scale) { return scale.list.empty(); })) return {};
  const JumpDensity<Dim> density(elements);
  const double least = options.least_jump_samples * *std::min_element(lattice.spacing.begin(), lattice.spacing.end());
  RidgeMesh<Dim> mesh = ridge_mesh(density, least);
  std::vector<char> jumps(mesh.facets.size(), 0);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const Vector<Dim> normal = area_vector(mesh, mesh.facets[f]);
    if (!(normal.norm() > 0)) continue;
    Vector<Dim> middle = Vector<Dim>::Zero();
    for (int corner : mesh.facets[f].corners) middle += mesh.vertices[static_cast<std::size_t>(corner)] / Dim;
    jumps[f] = density.jump_across(middle, normal.normalized()).norm() >= least;
  }
  const std::vector<Chart> charts = charts_of(mesh, lattice, jumps);
  std::vector<SwitchingSheet<Dim>> sheets(charts.size());
  const std::vector<std::vector<float>> places = paths_of(mesh, lattice, velocities);
  for (std::size_t s = 0; s < charts.size(); ++s) {
    SwitchingSheet<Dim>& sheet = sheets[s];
    sheet.axis = charts[s].axis;
    sheet.lattice = lattice;
    sheet.clean_distance = kObliqueCleanDistance;
    Vector<Dim> least_at = Vector<Dim>::Constant(1e30), most_at = -least_at;
    for (std::size_t f : charts[s].facets)
      for (int corner : mesh.facets[f].corners)
        for (const auto& place : places)
          for (int a = 0; a < Dim; ++a) {
            const double at =
                (place[static_cast<std::size_t>(Dim * corner + a)] - lattice.offset[a]) / lattice.spacing[a];
            least_at[a] = std::min(least_at[a], at);
            most_at[a] = std::max(most_at[a], at);
          }
    span_columns(sheet, least_at, most_at);
  }
  for (const auto& place : places) {
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
      for (int a = 0; a < Dim; ++a) mesh.vertices[v][a] = place[Dim * v + static_cast<std::size_t>(a)];
    for (std::size_t s = 0; s < charts.size(); ++s) sheets[s].nodes.push_back(cover(sheets[s], mesh, charts[s]));
  }
  return sheets;
}

template std::vector<SwitchingSheet<2>> slip_sheets(const std::vector<JumpElements<2>>&, const Lattice<2>&,
                                                    const std::vector<Field<float>>&, const SwitchingSheetOptions&);
template std::vector<SwitchingSheet<3>> slip_sheets(const std::vector<JumpElements<3>>&, const Lattice<3>&,
                                                    const std::vector<Field<float>>&, const SwitchingSheetOptions&);

}  // namespace saltus
