#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>

#include "core/grid/volume.h"

namespace saltus::testing {

/// A folder that lives as long as the test.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string("saltus-") + test->test_suite_name() + "-" + test->name() + "-";
    for (char& c : name) c = c == '/' ? '-' : c;
    path_ = std::filesystem::path(::testing::TempDir()) / (name + std::to_string(getpid()));
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Anisotropic, shifted, and turned about two axes (one in 2-D).
template <int Dim>
ImageGrid<Dim> oblique_grid() {
  ImageGrid<Dim> grid;
  if constexpr (Dim == 3) {
    grid.size = {7, 5, 4};
    grid.spacing = {0.9, 1.7, 4.1};
    grid.origin = {-31.25, 17.5, 203.125};
    grid.direction =
        (Eigen::AngleAxisd(0.5, Vector<3>::UnitX()) * Eigen::AngleAxisd(-0.3, Vector<3>::UnitZ())).toRotationMatrix();
  } else {
    grid.size = {7, 5};
    grid.spacing = {0.9, 1.7};
    grid.origin = {-31.25, 17.5};
    grid.direction = Eigen::Rotation2Dd(0.4).toRotationMatrix();
  }
  return grid;
}

/// Every sample differs from every other, and none is an integer.
template <int Dim>
Volume<Dim> sample_volume(const ImageGrid<Dim>& grid = oblique_grid<Dim>()) {
  Volume<Dim> volume(grid);
  for (std::size_t i = 0; i < volume.samples.size(); ++i) volume.samples[i] = 0.37f * i - 11.125f;
  return volume;
}

template <int Dim>
VectorVolume<Dim> sample_vectors(const ImageGrid<Dim>& grid = oblique_grid<Dim>()) {
  VectorVolume<Dim> vectors(grid);
  for (std::size_t i = 0; i < vectors.samples.size(); ++i) vectors.samples[i] = std::sin(1.0 + 0.7 * i);
  return vectors;
}

/// World positions agree at every corner of the grid.
template <int Dim>
void expect_same_place(const ImageGrid<Dim>& found, const ImageGrid<Dim>& expected, double tolerance_mm) {
  ASSERT_EQ(found.size, expected.size);
  for (int corner = 0; corner < (1 << Dim); ++corner) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = (corner >> axis & 1) * (expected.size[axis] - 1);
    EXPECT_LE((found.to_world(index) - expected.to_world(index)).norm(), tolerance_mm) << index.transpose();
  }
}

}  // namespace saltus::testing
