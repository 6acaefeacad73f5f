#include "core/slip/ridge_mesh.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

namespace saltus {
namespace {

constexpr double kLeastAgreement = 0.5;  // cosine between normals of one simplex

/// Strength and direction of the density at every site.
template <int Dim>
struct Directions {
  std::vector<float> strength;
  std::vector<Vector<Dim>> normal;  ///< of sites that are strong enough; 0 elsewhere
};

template <int Dim>
Directions<Dim> directions_of(const JumpDensity<Dim>& density, double least) {
  const Lattice<Dim>& lattice = density.lattice();
  Directions<Dim> found{std::vector<float>(lattice.sites()),
                        std::vector<Vector<Dim>>(lattice.sites(), Vector<Dim>::Zero())};
#pragma omp parallel for schedule(static)
  for (std::size_t site = 0; site < lattice.sites(); ++site) {
    const Eigen::Map<const Eigen::Matrix<float, Dim, Dim, Eigen::RowMajor>> tensor(density.values().data() +
                                                                                   Dim * Dim * site);
    const Matrix<Dim> b = tensor.template cast<double>();
    if (b.squaredNorm() == 0) continue;
    Eigen::SelfAdjointEigenSolver<Matrix<Dim>> solver;
    // The strength is no more than the norm, but for rounding.
    solver.computeDirect(b.transpose() * b,
                         b.norm() < 0.999 * least ? Eigen::EigenvaluesOnly : Eigen::ComputeEigenvectors);
    const double strength = std::sqrt(std::max(0.0, solver.eigenvalues()[Dim - 1]));
    found.strength[site] = static_cast<float>(strength);
    if (strength >= least) found.normal[site] = solver.eigenvectors().col(Dim - 1);
  }
  return found;
}

template <int Dim>
class Cutter {
 public:
  Cutter(const JumpDensity<Dim>& density, double least_density)
      : lattice_(density.lattice()), directions_(directions_of(density, least_density)) {
    std::size_t stride = 1;
    for (int a = 0; a < Dim; ++a) {
      strides_[a] = stride;
      stride *= static_cast<std::size_t>(lattice_.size[a]);
      order_[a] = a;
    }
    slopes_.resize(lattice_.sites());
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
        const Vector<Dim>& normal = directions_.normal[site];
        if (normal.squaredNorm() > 0) slopes_[site] = normal.dot(gradient(index, site));
      });
  }

  RidgeMesh<Dim> operator()() {
    for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
        for (int a = 0; a < Dim; ++a)
          if (index[a] + 1 >= lattice_.size[a]) return;
        if (directions_.normal[site].squaredNorm() == 0 || !changes_sign(site)) return;
        std::array<int, Dim> order = order_;
        do cut_simplex(index, site, order);
        while (std::next_permutation(order.begin(), order.end()));
      });
    return std::move(mesh_);
  }

 private:
  struct Corner {
    std::size_t site;
    Vector<Dim> at, normal;
    double slope = 0;  ///< n . grad rho
  };

  Vector<Dim> gradient(const Index<Dim>& index, std::size_t site) const {
    Vector<Dim> gradient;
    for (int a = 0; a < Dim; ++a) {
      const std::size_t low = index[a] > 0 ? site - strides_[a] : site,
                        high = index[a] + 1 < lattice_.size[a] ? site + strides_[a] : site;
      const double span = lattice_.spacing[a] * static_cast<double>((high - low) / strides_[a]);
      gradient[a] = (directions_.strength[high] - directions_.strength[low]) / span;
    }
    return gradient;
  }

  /// Whether the slopes of a cell's corners, along normals that agree with that of its first one, have both signs: else
  /// none of its simplices is cut.
  bool changes_sign(std::size_t first_site) const {
    bool any_above = false, any_below = false;
    for (std::size_t bits = 0; bits < (1u << Dim); ++bits) {
      std::size_t site = first_site;
      for (int a = 0; a < Dim; ++a)
        if (bits >> a & 1) site += strides_[a];
      const bool is_turned = directions_.normal[site].dot(directions_.normal[first_site]) < 0;
      const bool is_above = (is_turned ? -slopes_[site] : slopes_[site]) > 0;
      any_above = any_above || is_above;
      any_below = any_below || !is_above;
    }
    return any_above && any_below;
  }

  /// The simplex whose corners are reached from the cell's first along the axes in this order.
  void cut_simplex(const Index<Dim>& first, std::size_t first_site, const std::array<int, Dim>& order) {
    std::array<Corner, Dim + 1> corners;
    Index<Dim> index = first;
    std::size_t site = first_site;
    for (int k = 0; k <= Dim; ++k) {
      if (k > 0) {
        ++index[order[k - 1]];
        site += strides_[order[k - 1]];
      }
      Corner& corner = corners[k];
      corner.site = site;
      corner.normal = directions_.normal[site];
      corner.slope = slopes_[site];
      if (corner.normal.dot(corners[0].normal) < 0) {
        corner.normal = -corner.normal;
        corner.slope = -corner.slope;
      }
      for (int a = 0; a < Dim; ++a) corner.at[a] = lattice_.offset[a] + index[a] * lattice_.spacing[a];
      for (int j = 0; j < k; ++j)
        if (!(corner.normal.dot(corners[j].normal) > kLeastAgreement)) return;
    }
    int above = 0;
    for (const Corner& corner : corners) above += corner.slope > 0;
    if (above == 0 || above == Dim + 1) return;
    // The slope has to fall along n: else this is a valley between two sheets.
    Matrix<Dim> edges;
    Vector<Dim> rises, mean = corners[0].normal;
    for (int k = 1; k <= Dim; ++k) {
      edges.row(k - 1) = (corners[k].at - corners[0].at).transpose();
      rises[k - 1] = corners[k].slope - corners[0].slope;
      mean += corners[k].normal;
    }
    if (!((edges.inverse() * rises).dot(mean) < 0)) return;

    std::array<int, Dim + 1> high{}, low{};
    int highs = 0, lows = 0;
    for (int k = 0; k <= Dim; ++k) (corners[k].slope > 0 ? high[highs++] : low[lows++]) = k;
    const auto vertex = [&](int a, int b) { return vertex_between(corners[a], corners[b]); };
    if constexpr (Dim == 2) {
      if (highs == 1)
        add({vertex(high[0], low[0]), vertex(high[0], low[1])}, first_site);
      else
        add({vertex(high[0], low[0]), vertex(high[1], low[0])}, first_site);
    } else if (highs == 1 || lows == 1) {
      const auto& one = highs == 1 ? high : low;
      const auto& others = highs == 1 ? low : high;
      add({vertex(one[0], others[0]), vertex(one[0], others[1]), vertex(one[0], others[2])}, first_site);
    } else {
      const int a = vertex(high[0], low[0]), b = vertex(high[0], low[1]), c = vertex(high[1], low[1]),
                d = vertex(high[1], low[0]);
      add({a, b, c}, first_site);
      add({a, c, d}, first_site);
    }
  }

  int vertex_between(const Corner& a, const Corner& b) {
    const auto key = std::minmax(a.site, b.site);
    const auto [place, is_new] =
        vertex_of_.try_emplace({key.first, key.second}, static_cast<int>(mesh_.vertices.size()));
    if (is_new) mesh_.vertices.push_back(a.at + a.slope / (a.slope - b.slope) * (b.at - a.at));
    return place->second;
  }

  void add(const std::array<int, Dim>& corners, std::size_t cell) { mesh_.facets.push_back({corners, cell}); }

  const Lattice<Dim> lattice_;
  const Directions<Dim> directions_;
  std::vector<double> slopes_;  ///< n . grad rho at sites that have a normal
  std::array<std::size_t, Dim> strides_;
  std::array<int, Dim> order_;
  RidgeMesh<Dim> mesh_;
  std::map<std::pair<std::size_t, std::size_t>, int> vertex_of_;
};

}  // namespace

template <int Dim>
RidgeMesh<Dim> ridge_mesh(const JumpDensity<Dim>& density, double least_jump_mm) {
  double widest = 0;
  for (int a = 0; a < Dim; ++a) widest = std::max(widest, density.smoothing_along(Vector<Dim>::Unit(a)));
  return Cutter<Dim>(density, 0.5 * least_jump_mm / (std::sqrt(2 * std::numbers::pi) * widest))();
}

template <int Dim>
Vector<Dim> area_vector(const RidgeMesh<Dim>& mesh, const typename RidgeMesh<Dim>::Facet& facet) {
  const Vector<Dim> along = mesh.vertices[facet.corners[1]] - mesh.vertices[facet.corners[0]];
  if constexpr (Dim == 2)
    return {-along[1], along[0]};
  else
    return 0.5 * along.cross(Vector<3>(mesh.vertices[facet.corners[2]] - mesh.vertices[facet.corners[0]]));
}

#define SALTUS_RIDGE_MESH(DIM)                                         \
  template RidgeMesh<DIM> ridge_mesh(const JumpDensity<DIM>&, double); \
  template Vector<DIM> area_vector(const RidgeMesh<DIM>&, const typename RidgeMesh<DIM>::Facet&);
SALTUS_RIDGE_MESH(2)
SALTUS_RIDGE_MESH(3)
#undef SALTUS_RIDGE_MESH

}  // namespace saltus
