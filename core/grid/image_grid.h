#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace saltus {

/// Coordinates, displacements and directions: world millimetres (LPS) unless a name says otherwise.
template <int Dim>
using Vector = Eigen::Matrix<double, Dim, 1>;

template <int Dim>
using Matrix = Eigen::Matrix<double, Dim, Dim>;

/// Voxel index or size per axis, x first.
template <int Dim>
using Index = std::array<int, Dim>;

/// Where the voxels of an image are: world = origin + direction * (spacing .* index), ITK's convention.
/// Voxel centres have integer indices; x runs fastest in memory.
template <int Dim>
struct ImageGrid {
  Index<Dim> size{};
  Vector<Dim> spacing = Vector<Dim>::Ones();        ///< mm per voxel along each grid axis, > 0
  Vector<Dim> origin = Vector<Dim>::Zero();         ///< world position of voxel (0,...,0), mm
  Matrix<Dim> direction = Matrix<Dim>::Identity();  ///< column j is the world direction of grid axis j, orthonormal

  std::size_t voxels() const;
  double voxel_volume() const;  ///< mm^Dim
  Vector<Dim> to_world(const Vector<Dim>& continuous_index) const;
  Vector<Dim> to_index(const Vector<Dim>& world) const;

  bool operator==(const ImageGrid& other) const;
};

/// "166x195x25".
template <int Dim>
std::string size_text(const Index<Dim>& size);

/// Largest distance, mm, between the places that two grids of one size give a voxel.
template <int Dim>
double largest_distance(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b);

/// How far direction cosines may be off those of a rotation: their transpose is taken for their inverse, which a
/// thousand voxels further is off by a thousand times as much.
inline constexpr double kExactDirection = 1e-6;
/// As headers round them.
inline constexpr double kRoundedDirection = 1e-3;

/// Every reason why `grid` cannot be used (empty, non-finite or non-positive spacing, direction not orthonormal to
/// this).
template <int Dim>
std::vector<std::string> problems(const ImageGrid<Dim>& grid, double direction_tolerance = kExactDirection);

}  // namespace saltus
