// Where NIfTI files put their voxels: which form counts, and that no order or direction of axes is lost.
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/integration/image_io/nifti_bytes.h"
#include "tests/integration/image_io/sample_images.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

namespace saltus {
namespace {

using testing::expect_same_place;
using testing::NiftiBytes;
using testing::read_bytes;
using testing::sample_vectors;
using testing::sample_volume;
using testing::TemporaryFolder;
using testing::write_bytes;

// The rule that read_image.h states; what ITK 5.2 does with each file is the oracle for the three-slice case, which ITK
// places, and the one-slice case, which we place, must agree.
class NiftiPlacement : public ::testing::TestWithParam<int> {
 protected:
  ImageGrid<3> grid_for(std::int16_t qform_code, std::int16_t sform_code, const std::array<float, 12>& sform) const {
    const TemporaryFolder folder;
    NiftiBytes nifti({2, 3, static_cast<std::int16_t>(GetParam())});
    nifti.half_turn_qform(qform_code, 50).sform(sform_code, sform);
    write_bytes(folder / "a.nii", nifti.bytes + std::string(6 * GetParam(), 'v'));
    return read_grid<3>(folder / "a.nii");
  }
  /// RAS identity axes, shifted by 7: in LPS the directions are -1, -1, 1.
  const std::array<float, 12> shifted{1, 0, 0, 7, 0, 1, 0, 0, 0, 0, 1, 0};
  const Vector<3> by_sform{-7, 0, 0};
  const Vector<3> by_qform{-50, 0, 0};
};

TEST_P(NiftiPlacement, ScannerSformWinsOverQform) {
  const auto grid = grid_for(1, 1, shifted);
  EXPECT_EQ(grid.origin, by_sform);
  EXPECT_EQ(grid.direction, Matrix<3>(Vector<3>(-1, -1, 1).asDiagonal()));
}

TEST_P(NiftiPlacement, QformWinsOverAnotherSform) {
  const auto grid = grid_for(1, 2, shifted);
  EXPECT_EQ(grid.origin, by_qform);
  EXPECT_LE((grid.direction - Matrix<3>::Identity()).norm(), 1e-6);
}

TEST_P(NiftiPlacement, SformIsUsedWithoutQform) { EXPECT_EQ(grid_for(0, 2, shifted).origin, by_sform); }

TEST_P(NiftiPlacement, QformIsUsedWithoutSform) { EXPECT_EQ(grid_for(1, 0, shifted).origin, by_qform); }

TEST_P(NiftiPlacement, ShearedSformLosesToQform) {
  EXPECT_EQ(grid_for(1, 1, {1, 0.3f, 0, 7, 0, 1, 0, 0, 0, 0, 1, 0}).origin, by_qform);
}

TEST_P(NiftiPlacement, ShearedSformWithoutQformIsRefused) {
  EXPECT_THROW(grid_for(0, 1, {1, 0.3f, 0, 7, 0, 1, 0, 0, 0, 0, 1, 0}), FileError);
}

TEST_P(NiftiPlacement, WithoutFormsThereIsNoRotation) {
  const auto grid = grid_for(0, 0, shifted);
  EXPECT_EQ(grid.origin, Vector<3>(0, 0, 0));
  EXPECT_EQ(grid.direction.cwiseAbs(), Matrix<3>::Identity()) << grid.direction;
  EXPECT_EQ(grid.direction, Matrix<3>::Identity()) << grid.direction;
}

INSTANTIATE_TEST_SUITE_P(Slices, NiftiPlacement, ::testing::Values(3, 1));

/// A grid whose axes run along the world's, in this order and each forwards or backwards: one of 48.
ImageGrid<3> axis_order(int number) {
  std::array<int, 3> order{0, 1, 2};
  for (int i = 0; i < number / 8; ++i) std::next_permutation(order.begin(), order.end());
  ImageGrid<3> grid;
  grid.size = {4, 3, 5};
  grid.spacing = {0.75, 1.5, 2.25};
  grid.origin = {-31.5, 17.25, 203};
  grid.direction.setZero();
  for (int axis = 0; axis < 3; ++axis) grid.direction(order[axis], axis) = (number >> axis & 1) ? -1 : 1;
  return grid;
}

template <class Value>
Value value_at(const std::string& bytes, std::size_t offset) {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

/// RAS position of a voxel by the file's sform, as the NIfTI standard defines it (method 3).
Vector<3> by_sform(const std::string& bytes, const Vector<3>& index) {
  Vector<3> world;
  for (int row = 0; row < 3; ++row) {
    world[row] = value_at<float>(bytes, 280 + 16 * row + 12);
    for (int axis = 0; axis < 3; ++axis) world[row] += value_at<float>(bytes, 280 + 16 * row + 4 * axis) * index[axis];
  }
  return world;
}

/// The same by its qform (method 2): a unit quaternion, offsets, and the sign of the third axis in pixdim[0].
Vector<3> by_qform(const std::string& bytes, const Vector<3>& index) {
  Eigen::Quaterniond turn(0, value_at<float>(bytes, 256), value_at<float>(bytes, 260), value_at<float>(bytes, 264));
  // The reference implementation takes what is left by rounding for a half turn.
  const double rest = 1 - turn.squaredNorm();
  if (rest >= 1e-7)
    turn.w() = std::sqrt(rest);
  else
    turn.normalize();
  Vector<3> scaled;
  for (int axis = 0; axis < 3; ++axis) scaled[axis] = index[axis] * value_at<float>(bytes, 80 + 4 * axis);
  if (value_at<float>(bytes, 76) < 0) scaled[2] = -scaled[2];
  Vector<3> world = turn.toRotationMatrix() * scaled;
  for (int row = 0; row < 3; ++row) world[row] += value_at<float>(bytes, 268 + 4 * row);
  return world;
}

class NiftiAxisOrder : public ::testing::TestWithParam<int> {};

// Oracle: the standard's formulas over the bytes of the file.
TEST_P(NiftiAxisOrder, IsWrittenAndReadInBothForms) {
  const ImageGrid<3> grid = axis_order(GetParam());
  const TemporaryFolder folder;
  const Volume<3> volume = sample_volume<3>(grid);
  write_volume(folder / "a.nii", volume);
  const std::string bytes = read_bytes(folder / "a.nii");
  ASSERT_GT(value_at<std::int16_t>(bytes, 252), 0) << "no qform";
  ASSERT_GT(value_at<std::int16_t>(bytes, 254), 0) << "no sform";
  for (const Vector<3>& index : {Vector<3>(0, 0, 0), Vector<3>(3, 0, 0), Vector<3>(0, 2, 0), Vector<3>(0, 0, 4)}) {
    const Vector<3> lps = grid.to_world(index), ras(-lps[0], -lps[1], lps[2]);
    EXPECT_LT((by_sform(bytes, index) - ras).norm(), 1e-4);
    EXPECT_LT((by_qform(bytes, index) - ras).norm(), 1e-4);
  }
  const Volume<3> back = read_volume<3>(folder / "a.nii");
  expect_same_place(back.grid, grid, 1e-4);
  EXPECT_EQ(back.samples, volume.samples);

  // Either form alone says the same.
  for (const std::size_t code : {252, 254}) {
    std::string one = bytes;
    one[code] = one[code + 1] = 0;
    write_bytes(folder / "one.nii", one);
    expect_same_place(read_grid<3>(folder / "one.nii"), grid, 1e-4);
  }
}

TEST_P(NiftiAxisOrder, LeavesTheComponentsOfADisplacementAlone) {
  const ImageGrid<3> grid = axis_order(GetParam());
  const TemporaryFolder folder;
  const VectorVolume<3> vectors = sample_vectors<3>(grid);
  write_vector_volume(folder / "u.nii.gz", vectors);
  const VectorVolume<3> back = read_vector_volume<3>(folder / "u.nii.gz");
  expect_same_place(back.grid, grid, 1e-4);
  EXPECT_EQ(back.samples, vectors.samples);
}

INSTANTIATE_TEST_SUITE_P(All, NiftiAxisOrder, ::testing::Range(0, 48));

}  // namespace
}  // namespace saltus
