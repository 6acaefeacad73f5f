// Oracle: ITK reads the file back, and linear interpolation of u is written out here.
#include "core/image_io/write_transform.h"

#include <itkHDF5TransformIO.h>
#include <itkTransform.h>
#include <itkTransformFactoryBase.h>
#include <itkTransformFileReader.h>

#include <random>

#include "core/support/errors.h"
#include "tests/integration/image_io/sample_images.h"

namespace saltus {
namespace {

using testing::oblique_grid;
using testing::sample_vectors;
using testing::TemporaryFolder;

/// Multilinear interpolation inside the grid.
template <int Dim>
Vector<Dim> interpolated(const VectorVolume<Dim>& field, const Vector<Dim>& index) {
  Vector<Dim> result = Vector<Dim>::Zero();
  for (int corner = 0; corner < (1 << Dim); ++corner) {
    double weight = 1;
    std::size_t offset = 0;
    for (int axis = Dim - 1; axis >= 0; --axis) {
      const int low = static_cast<int>(index[axis]);
      const int bit = corner >> axis & 1;
      weight *= bit ? index[axis] - low : 1 - (index[axis] - low);
      offset = offset * field.grid.size[axis] + std::min(low + bit, field.grid.size[axis] - 1);
    }
    for (int c = 0; c < Dim; ++c) result[c] += weight * field.component(c)[offset];
  }
  return result;
}

template <typename Real, int Dim>
void maps_like_the_field() {
  const TemporaryFolder folder;
  const auto path = folder / "transform.h5";
  const VectorVolume<Dim> field = sample_vectors<Dim>();
  write_transform(path, field);

  using Reader = itk::TransformFileReaderTemplate<Real>;
  itk::TransformFactoryBase::RegisterDefaultTransforms();
  const auto reader = Reader::New();
  reader->SetTransformIO(itk::HDF5TransformIOTemplate<Real>::New());
  reader->SetFileName(path.string());
  reader->Update();
  ASSERT_EQ(reader->GetTransformList()->size(), 1u);
  auto* transform = dynamic_cast<itk::Transform<Real, Dim, Dim>*>(reader->GetTransformList()->front().GetPointer());
  ASSERT_NE(transform, nullptr);
  EXPECT_NE(std::string(transform->GetNameOfClass()).find("Composite"), std::string::npos);

  std::mt19937 generator(3);
  // Points are stored as Real: an ulp of 250 mm in single precision is 1.5e-5, and slopes of u are about 1 a mm.
  const double tolerance = sizeof(Real) == 4 ? 2e-4 : 1e-6;
  for (int i = 0; i < 200; ++i) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis)
      index[axis] = (0.01 + 0.98 * (generator() / 4294967296.0)) * (field.grid.size[axis] - 1);
    const Vector<Dim> world = field.grid.to_world(index);
    const Vector<Dim> expected = world + interpolated(field, index);
    itk::Point<Real, Dim> point;
    for (int axis = 0; axis < Dim; ++axis) point[axis] = world[axis];
    const auto mapped = transform->TransformPoint(point);
    for (int axis = 0; axis < Dim; ++axis) ASSERT_NEAR(mapped[axis], expected[axis], tolerance) << index.transpose();
  }
}

TEST(WriteTransform, ItkMapsPointsByLinearInterpolationOfTheField2d) { maps_like_the_field<double, 2>(); }
TEST(WriteTransform, ItkMapsPointsByLinearInterpolationOfTheField3d) { maps_like_the_field<double, 3>(); }
TEST(WriteTransform, SinglePrecisionReadersAgree) { maps_like_the_field<float, 3>(); }

TEST(WriteTransform, RefusesOtherSuffixesAndFieldsThatDoNotFit) {
  const TemporaryFolder folder;
  auto field = sample_vectors<2>();
  EXPECT_THROW(write_transform(folder / "transform.tfm", field), InvalidInput);
  EXPECT_THROW(write_transform(folder / "absent/transform.h5", field), FileError);
  field.samples.pop_back();
  EXPECT_THROW(write_transform(folder / "transform.h5", field), InvalidInput);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace saltus
