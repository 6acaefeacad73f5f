#include "core/slip/measure_slip.h"

#include "core/flow/backward_map.h"
#include "core/grid/interpolation.h"
#include "core/slip/ridge_mesh.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace saltus {
namespace {

constexpr double kNearest = 2.5, kFarthest = 6.5;  // of what a side of u is read from, in samples off the surface
constexpr int kReadings = 5;
constexpr double kPlaneRadius = 2.5;        // around the nearest piece, in samples
constexpr double kLeastOutwardShare = 0.1;  // of a part that is bent enough to have an outside

/// A piece of surface while it is made.
template <int Dim>
struct Piece {
  std::size_t begin = 0, end = 0;  ///< its facets
  Vector<Dim> at, normal;          ///< in the frame
  double area = 0, velocity_jump = 0;
  Vector<Dim> above, below;  ///< psi(x) - x on the side of the normal and on the other
  bool is_told = false;      ///< by both images, on both sides
  int part = -1;

  void flip() {
    normal = -normal;
    std::swap(above, below);
  }
};

/// Middle, area and unit normal from its facets, whose signs are made to agree.
template <int Dim>
void place(const RidgeMesh<Dim>& mesh, Piece<Dim>& piece) {
  Vector<Dim> sum = Vector<Dim>::Zero(), at = Vector<Dim>::Zero();
  double area = 0;
  for (std::size_t f = piece.begin; f < piece.end; ++f) {
    const auto& facet = mesh.facets[f];
    Vector<Dim> vector = area_vector(mesh, facet), middle = Vector<Dim>::Zero();
    if (vector.dot(sum) < 0) vector = -vector;
    for (int corner : facet.corners) middle += mesh.vertices[static_cast<std::size_t>(corner)] / Dim;
    sum += vector;
    at += vector.norm() * middle;
    area += vector.norm();
  }
  piece.area = area;
  if (!(area > 0)) return;
  piece.at = at / area;
  piece.normal = sum.normalized();
}

template <int Dim>
std::vector<Piece<Dim>> pieces_of(const RidgeMesh<Dim>& mesh) {
  std::vector<Piece<Dim>> pieces;
  for (std::size_t begin = 0, end = 0; begin < mesh.facets.size(); begin = end) {
    while (end < mesh.facets.size() && mesh.facets[end].cell == mesh.facets[begin].cell) ++end;
    Piece<Dim> piece;
    piece.begin = begin;
    piece.end = end;
    place(mesh, piece);
    if (piece.area > 0) pieces.push_back(piece);
  }
  return pieces;
}

/// Pieces by the vertices that they have in common.
template <int Dim>
std::vector<std::vector<std::size_t>> neighbours_of(const RidgeMesh<Dim>& mesh, const std::vector<Piece<Dim>>& pieces) {
  std::vector<std::vector<std::size_t>> at_vertex(mesh.vertices.size()), neighbours(pieces.size());
  for (std::size_t p = 0; p < pieces.size(); ++p)
    for (std::size_t f = pieces[p].begin; f < pieces[p].end; ++f)
      for (int corner : mesh.facets[f].corners) {
        auto& there = at_vertex[static_cast<std::size_t>(corner)];
        if (there.empty() || there.back() != p) there.push_back(p);
      }
  for (const auto& there : at_vertex)
    for (std::size_t a : there)
      for (std::size_t b : there)
        if (a != b) neighbours[a].push_back(b);
  return neighbours;
}

/// Numbers the connected parts, the largest first, and makes the normals within each agree. A part that is bent has
/// them outwards; of one that is flat the largest component of the mean normal is positive.
template <int Dim>
void sort_into_parts(const RidgeMesh<Dim>& mesh, std::vector<Piece<Dim>>& pieces) {
  const auto neighbours = neighbours_of(mesh, pieces);
  std::vector<std::vector<std::size_t>> parts;
  for (std::size_t seed = 0; seed < pieces.size(); ++seed) {
    if (pieces[seed].part >= 0) continue;
    std::vector<std::size_t> members{seed};
    pieces[seed].part = 0;
    for (std::size_t i = 0; i < members.size(); ++i)
      for (std::size_t other : neighbours[members[i]]) {
        if (pieces[other].part >= 0) continue;
        pieces[other].part = 0;
        if (pieces[other].normal.dot(pieces[members[i]].normal) < 0) pieces[other].flip();
        members.push_back(other);
      }
    Vector<Dim> middle = Vector<Dim>::Zero(), mean = Vector<Dim>::Zero();
    double area = 0, outward = 0, reach = 0;
    for (std::size_t p : members) {
      middle += pieces[p].area * pieces[p].at;
      mean += pieces[p].area * pieces[p].normal;
      area += pieces[p].area;
    }
    middle /= area;
    for (std::size_t p : members) {
      outward += pieces[p].area * pieces[p].normal.dot(pieces[p].at - middle);
      reach += pieces[p].area * (pieces[p].at - middle).norm();
    }
    Eigen::Index largest = 0;
    mean.cwiseAbs().maxCoeff(&largest);
    const bool is_bent = std::abs(outward) > kLeastOutwardShare * reach;
    if (is_bent ? outward < 0 : mean[largest] < 0)
      for (std::size_t p : members) pieces[p].flip();
    parts.push_back(std::move(members));
  }
  const auto area_of = [&](const std::vector<std::size_t>& part) {
    return std::accumulate(part.begin(), part.end(), 0.0,
                           [&](double sum, std::size_t p) { return sum + pieces[p].area; });
  };
  std::stable_sort(parts.begin(), parts.end(), [&](const auto& a, const auto& b) { return area_of(a) > area_of(b); });
  for (std::size_t part = 0; part < parts.size(); ++part)
    for (std::size_t p : parts[part]) pieces[p].part = static_cast<int>(part);
}

/// psi(x) - x on one side of the surface, continued to it; `away` is a step of one sample off it.
template <int Dim>
Vector<Dim> side_value(const Lattice<Dim>& lattice, const Field<float>& field, const Vector<Dim>& x,
                       const Vector<Dim>& away) {
  Vector<Dim> sum = Vector<Dim>::Zero(), moment = Vector<Dim>::Zero();
  double spread = 0;
  const double middle = (kNearest + kFarthest) / 2;
  for (int k = 0; k < kReadings; ++k) {
    const double off = kNearest + (kFarthest - kNearest) * k / (kReadings - 1);
    std::array<double, Dim> at;
    for (int a = 0; a < Dim; ++a) at[a] = (x[a] + off * away[a] - lattice.offset[a]) / lattice.spacing[a];
    const LinearCell<Dim, double> cell(lattice, at);
    for (int bits = 0; bits < LinearCell<Dim, double>::corners; ++bits)
      for (int c = 0; c < Dim; ++c) {
        const double value = cell.weight(bits) * field[Dim * cell.corner(bits) + c];
        sum[c] += value;
        moment[c] += (off - middle) * value;
      }
    spread += (off - middle) * (off - middle);
  }
  return sum / kReadings - middle * moment / spread;
}

template <int Dim>
bool is_in(const ImageGrid<Dim>& image, const Vector<Dim>& index) {
  for (int a = 0; a < Dim; ++a)
    if (!(index[a] >= -0.5 && index[a] <= image.size[a] - 0.5)) return false;
  return true;
}

/// Whether most of what a side is read from lies in the fixed image and, carried along, in the moving one.
template <int Dim>
bool is_told(const SlipFlow<Dim>& flow, const Vector<Dim>& x, const Vector<Dim>& away) {
  const Lattice<Dim> fixed = lattice_of(flow.fixed);
  int told = 0;
  for (int k = 0; k < kReadings; ++k) {
    const Vector<Dim> at = x + (kNearest + (kFarthest - kNearest) * k / (kReadings - 1)) * away;
    std::array<double, Dim> index;
    Vector<Dim> voxel, moved = at;
    for (int a = 0; a < Dim; ++a) voxel[a] = index[a] = at[a] / fixed.spacing[a];
    const LinearCell<Dim, double> cell(fixed, index);
    for (int bits = 0; bits < LinearCell<Dim, double>::corners; ++bits)
      for (int c = 0; c < Dim; ++c) moved[c] += cell.weight(bits) * flow.backward[Dim * cell.corner(bits) + c];
    const Vector<Dim> world = flow.fixed.origin + flow.fixed.direction * moved;
    told += is_in(flow.fixed, voxel) && is_in(flow.moving, flow.moving.to_index(flow.start(world)));
  }
  return 2 * told > kReadings;
}

/// Takes away parts most of which is not told, and numbers the others anew.
template <int Dim>
void keep_what_is_told(std::vector<Piece<Dim>>& pieces) {
  std::map<int, double> area, told;
  for (const Piece<Dim>& piece : pieces) {
    area[piece.part] += piece.area;
    told[piece.part] += piece.is_told ? piece.area : 0;
  }
  std::map<int, int> number;
  for (const auto& [part, whole] : area)
    if (2 * told[part] >= whole) number.emplace(part, static_cast<int>(number.size()));
  std::erase_if(pieces, [&](const Piece<Dim>& piece) { return !number.contains(piece.part); });
  for (Piece<Dim>& piece : pieces) piece.part = number[piece.part];
}

/// Points in buckets, to be found again by where they are.
template <int Dim>
class Buckets {
 public:
  Buckets(const std::vector<Vector<Dim>>& points, double size) : points_(points), size_(size) {
    for (std::size_t i = 0; i < points.size(); ++i) buckets_[bucket_of(points[i])].push_back(i);
  }

  /// Of the points that `is_wanted`; that of the smaller number where two are as near. points.size() when there is none
  /// in `rings` buckets around.
  template <class Wanted>
  std::size_t nearest(const Vector<Dim>& x, Wanted&& is_wanted) const {
    std::size_t best = points_.size();
    double least = 0;
    for (int ring = 1; ring <= kMostRings; ring *= 2) {
      visit(x, ring, [&](std::size_t i) {
        const double distance = (points_[i] - x).norm();
        if (!is_wanted(i) || (best < points_.size() && !(distance < least || (distance == least && i < best)))) return;
        best = i;
        least = distance;
      });
      if (best < points_.size() && least <= ring * size_) break;  // nothing outside of the rings is nearer
    }
    return best;
  }

  /// Visits all points at most `rings` buckets away, and some more.
  template <class Visit>
  void visit(const Vector<Dim>& x, int rings, Visit&& visit) const {
    const Index<Dim> middle = bucket_of(x);
    Lattice<Dim> around;
    around.size.fill(2 * rings + 1);
    for (int slab = 0; slab < around.size[Dim - 1]; ++slab)
      visit_slab<Dim>(around, slab, [&](const Index<Dim>& index, std::size_t) {
        Index<Dim> at;
        for (int a = 0; a < Dim; ++a) at[a] = middle[a] + index[a] - rings;
        if (const auto found = buckets_.find(at); found != buckets_.end())
          for (std::size_t i : found->second) visit(i);
      });
  }

 private:
  static constexpr int kMostRings = 32;
  Index<Dim> bucket_of(const Vector<Dim>& x) const {
    Index<Dim> bucket;
    for (int a = 0; a < Dim; ++a) bucket[a] = static_cast<int>(std::floor(x[a] / size_));
    return bucket;
  }

  const std::vector<Vector<Dim>>& points_;
  double size_;
  std::map<Index<Dim>, std::vector<std::size_t>> buckets_;
};

/// Distance of `from` from the plane through `points` (those of the - side) around the nearest one, along its normal on
/// the side of `normal`. Pieces of other parts are other surfaces.
template <int Dim>
double distance_from(const Buckets<Dim>& buckets, const std::vector<Vector<Dim>>& points,
                     const std::vector<Piece<Dim>>& pieces, std::size_t own, const Vector<Dim>& from, double radius) {
  const auto is_alike = [&](std::size_t i) {
    return pieces[i].part == pieces[own].part && pieces[i].normal.dot(pieces[own].normal) > 0.5;
  };
  std::size_t nearest = buckets.nearest(from, is_alike);
  if (nearest == points.size()) nearest = own;
  Vector<Dim> middle = Vector<Dim>::Zero();
  Matrix<Dim> squares = Matrix<Dim>::Zero();
  double weights = 0;
  int count = 0;
  buckets.visit(points[nearest], 1, [&](std::size_t i) {
    const Vector<Dim> apart = points[i] - points[nearest];
    if (!is_alike(i) || apart.norm() > radius) return;
    middle += pieces[i].area * apart;
    squares += pieces[i].area * apart * apart.transpose();
    weights += pieces[i].area;
    ++count;
  });
  Vector<Dim> normal = pieces[nearest].normal;
  if (count >= 2 * Dim) {
    middle /= weights;
    Eigen::SelfAdjointEigenSolver<Matrix<Dim>> solver;
    solver.computeDirect(squares / weights - middle * middle.transpose());
    normal = solver.eigenvectors().col(0);
    if (normal.dot(pieces[nearest].normal) < 0) normal = -normal;
  } else {
    middle.setZero();
  }
  return normal.dot(from - points[nearest] - middle);
}

}  // namespace

template <int Dim>
SlipSurface<Dim> measure_slip(const std::vector<JumpElements<Dim>>& elements, const SlipFlow<Dim>& flow,
                              const SlipSurfaceOptions& options) {
  SlipSurface<Dim> surface;
  if (std::all_of(elements.begin(), elements.end(), [](const auto& scale) { return scale.list.empty(); }))
    return surface;
  const JumpDensity<Dim> density(elements);
  const double sample = *std::min_element(density.lattice().spacing.begin(), density.lattice().spacing.end());
  surface.least_jump_mm = options.least_jump_samples * sample;
  RidgeMesh<Dim> mesh = ridge_mesh(density, surface.least_jump_mm);
  std::vector<Piece<Dim>> pieces = pieces_of(mesh);
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < pieces.size(); ++p)
    pieces[p].velocity_jump = density.jump_across(pieces[p].at, pieces[p].normal).norm();
  double largest = 0;
  for (const Piece<Dim>& piece : pieces) largest = std::max(largest, piece.velocity_jump);
  surface.least_jump_mm = std::max(surface.least_jump_mm, options.least_share * largest);
  std::erase_if(pieces, [&](const Piece<Dim>& piece) { return piece.velocity_jump < surface.least_jump_mm; });

#pragma omp parallel for schedule(static)
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    mesh.vertices[v] = forward_guess<Dim, float>(flow.lattice, flow.velocities, mesh.vertices[v]);
  const Lattice<Dim> fixed = lattice_of(flow.fixed);
  std::erase_if(pieces, [&](Piece<Dim>& piece) {
    place(mesh, piece);
    if (!(piece.area > 0)) return true;
    for (int a = 0; a < Dim; ++a)
      if (std::abs(piece.at[a] / fixed.spacing[a] - 0.5 * (fixed.size[a] - 1)) > 0.5 * fixed.size[a]) return true;
    return false;
  });
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < pieces.size(); ++p) {
    Piece<Dim>& piece = pieces[p];
    const double step = std::max(cell_along<Dim>(fixed, piece.normal), cell_along<Dim>(flow.lattice, piece.normal));
    piece.above = side_value<Dim>(fixed, flow.backward, piece.at, step * piece.normal);
    piece.below = side_value<Dim>(fixed, flow.backward, piece.at, -step * piece.normal);
    piece.is_told =
        is_told<Dim>(flow, piece.at, step * piece.normal) && is_told<Dim>(flow, piece.at, -step * piece.normal);
  }
  std::erase_if(pieces, [&](const Piece<Dim>& piece) {
    const Vector<Dim> jump = piece.above - piece.below;
    return (jump - jump.dot(piece.normal) * piece.normal).norm() < surface.least_jump_mm;
  });
  sort_into_parts(mesh, pieces);
  keep_what_is_told(pieces);

  const std::size_t count = pieces.size();
  std::vector<Vector<Dim>> above(count), below(count);
  const Matrix<Dim> turn = flow.start.linear * flow.fixed.direction;
  for (std::size_t p = 0; p < count; ++p) {
    const Vector<Dim> world = flow.fixed.origin + flow.fixed.direction * pieces[p].at;
    above[p] = flow.start(world) + turn * pieces[p].above;
    below[p] = flow.start(world) + turn * pieces[p].below;
  }
  // The pieces lie in the moving image, which may be larger or smaller.
  const double scale = std::pow(std::abs(flow.start.linear.determinant()), 1.0 / Dim);
  const double radius =
      kPlaneRadius * scale * *std::max_element(density.lattice().spacing.begin(), density.lattice().spacing.end());
  for (Piece<Dim>& piece : pieces) piece.normal = flow.fixed.direction * piece.normal;
  const Buckets<Dim> buckets(below, radius);
  surface.points.resize(count);
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < count; ++p) {
    const Piece<Dim>& piece = pieces[p];
    SlipPoint<Dim>& point = surface.points[p];
    point.position = flow.fixed.origin + flow.fixed.direction * piece.at;
    point.normal = piece.normal;
    point.area = piece.area;
    point.jump = turn * (piece.above - piece.below);
    point.jump -= point.jump.dot(piece.normal) * piece.normal;
    point.gap_mm = distance_from(buckets, below, pieces, p, above[p], radius);
    point.velocity_jump_mm = piece.velocity_jump;
    point.part = piece.part;
  }
  std::stable_sort(surface.points.begin(), surface.points.end(),
                   [](const SlipPoint<Dim>& a, const SlipPoint<Dim>& b) { return a.part < b.part; });
  return surface;
}

template SlipSurface<2> measure_slip(const std::vector<JumpElements<2>>&, const SlipFlow<2>&,
                                     const SlipSurfaceOptions&);
template SlipSurface<3> measure_slip(const std::vector<JumpElements<3>>&, const SlipFlow<3>&,
                                     const SlipSurfaceOptions&);

}  // namespace saltus
