#include "core/grid/crop.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "core/support/errors.h"

namespace saltus {
namespace {

template <int Dim>
Volume<Dim> numbered_volume(const Index<Dim>& size) {
  ImageGrid<Dim> grid;
  grid.size = size;
  for (int axis = 0; axis < Dim; ++axis) {
    grid.spacing[axis] = 0.5 + axis;
    grid.origin[axis] = 10.0 * axis - 7;
  }
  if constexpr (Dim == 3) {
    grid.direction =
        (Eigen::AngleAxisd(0.4, Vector<3>::UnitY()) * Eigen::AngleAxisd(1.1, Vector<3>::UnitX())).toRotationMatrix();
  } else {
    grid.direction = Eigen::Rotation2Dd(0.7).toRotationMatrix();
  }
  Volume<Dim> volume(grid);
  for (std::size_t i = 0; i < volume.samples.size(); ++i) volume.samples[i] = static_cast<float>(i);
  return volume;
}

// Oracle: brute force, the sample found at the same world position of the whole image.
template <int Dim>
void expect_same_sample_at_same_place(const Volume<Dim>& image, const Index<Dim>& begin, const Index<Dim>& end) {
  const Volume<Dim> box = crop(image, begin, end);
  for (std::size_t i = 0; i < box.samples.size(); ++i) {
    Vector<Dim> index;
    std::size_t rest = i;
    for (int axis = 0; axis < Dim; ++axis) {
      index[axis] = rest % box.grid.size[axis];
      rest /= box.grid.size[axis];
    }
    const Vector<Dim> whole = image.grid.to_index(box.grid.to_world(index));
    std::size_t offset = 0;
    for (int axis = Dim - 1; axis >= 0; --axis) {
      ASSERT_NEAR(whole[axis], std::round(whole[axis]), 1e-9);
      offset = offset * image.grid.size[axis] + std::lround(whole[axis]);
    }
    ASSERT_EQ(box.samples[i], image.samples[offset]);
  }
  for (int axis = 0; axis < Dim; ++axis) EXPECT_EQ(box.grid.size[axis], end[axis] - begin[axis]);
}

TEST(Crop, KeepsEverySampleAtItsWorldPosition) {
  expect_same_sample_at_same_place<2>(numbered_volume<2>({7, 5}), {2, 1}, {6, 5});
  expect_same_sample_at_same_place<3>(numbered_volume<3>({5, 6, 7}), {1, 2, 3}, {5, 3, 6});
}

TEST(Crop, OfTheWholeImageIsTheImage) {
  const auto image = numbered_volume<3>({4, 3, 2});
  const auto box = crop(image, {0, 0, 0}, {4, 3, 2});
  EXPECT_EQ(box.grid, image.grid);
  EXPECT_EQ(box.samples, image.samples);
}

TEST(Crop, RefusesABoxThatIsEmptyOrOutside) {
  const auto image = numbered_volume<2>({4, 3});
  EXPECT_THROW(crop(image, {0, 0}, {5, 3}), InvalidInput);
  EXPECT_THROW(crop(image, {-1, 0}, {4, 3}), InvalidInput);
  EXPECT_THROW(crop(image, {2, 0}, {2, 3}), InvalidInput);
  try {
    crop(image, {0, 2}, {4, 4});
    FAIL();
  } catch (const InvalidInput& error) {
    EXPECT_STREQ(error.what(), "crop takes voxels 2 to 4 (exclusive) of axis 1; choose 0 <= begin < end <= 3");
  }
}

}  // namespace
}  // namespace saltus
