// Oracle: ITK reads the file back, and linear interpolation of u is written out here.
#include "core/image_io/write_transform.h"

#include <itkCompositeTransform.h>
#include <itkDisplacementFieldTransform.h>
#include <itkHDF5TransformIO.h>
#include <itkTransform.h>
#include <itkTransformFactoryBase.h>
#include <itkTransformFileReader.h>

#include <csignal>
#include <random>

#include <sys/resource.h>
#include <unistd.h>

#include "core/image_io/itk_geometry.h"
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

/// What a file holds: each transform's type, its fixed parameters and its parameters.
struct Content {
  std::vector<std::string> types;
  std::vector<std::vector<double>> fixed;
  std::vector<std::vector<float>> parameters;
  bool operator==(const Content&) const = default;
};

Content content_of(const std::filesystem::path& path) {
  const auto reader = itk::TransformFileReaderTemplate<float>::New();
  itk::TransformFactoryBase::RegisterDefaultTransforms();
  reader->SetTransformIO(itk::HDF5TransformIOTemplate<float>::New());
  reader->SetFileName(path.string());
  reader->Update();
  Content content;
  for (const auto& one : *reader->GetTransformList()) {
    auto list = std::vector<itk::TransformBaseTemplate<float>*>{one.GetPointer()};
    if (const auto* composite = dynamic_cast<itk::CompositeTransform<float, 3>*>(one.GetPointer()))
      for (const auto& part : composite->GetTransformQueue()) list.push_back(part.GetPointer());
    for (auto* transform : list) {
      content.types.push_back(transform->GetTransformTypeAsString());
      const auto& fixed = transform->GetFixedParameters();
      content.fixed.emplace_back(fixed.begin(), fixed.end());
      const auto& values = transform->GetParameters();
      content.parameters.emplace_back(values.begin(), values.end());
    }
  }
  return content;
}

TEST(WriteTransform, HoldsWhatItkWritesOfTheSameField) {
  const TemporaryFolder folder;
  // One that is written in several pieces, and one that is thin.
  for (const Index<3> size : {Index<3>{41, 30, 29}, Index<3>{40, 3, 1}}) {
    auto grid = oblique_grid<3>();
    grid.size = size;
    const VectorVolume<3> displacement = sample_vectors<3>(grid);
    write_transform(folder / "transform.h5", displacement);

    using FieldTransform = itk::DisplacementFieldTransform<float, 3>;
    const auto field = FieldTransform::DisplacementFieldType::New();
    set_geometry(*field, grid);
    field->Allocate();
    for (std::size_t i = 0; i < grid.voxels(); ++i)
      for (int c = 0; c < 3; ++c) field->GetBufferPointer()[i][c] = displacement.component(c)[i];
    const auto transform = FieldTransform::New();
    transform->SetDisplacementField(field);
    const auto composite = itk::CompositeTransform<float, 3>::New();
    composite->AddTransform(transform);
    const auto writer = itk::HDF5TransformIOTemplate<float>::New();
    itk::HDF5TransformIOTemplate<float>::ConstTransformListType list;
    list.push_back(composite.GetPointer());
    writer->SetTransformList(list);
    writer->SetFileName((folder / "itk.h5").string());
    writer->Write();

    const Content found = content_of(folder / "transform.h5");
    ASSERT_EQ(found.parameters.size(), 2u);
    EXPECT_EQ(found.parameters.back().size(), 3 * grid.voxels());
    EXPECT_TRUE(found == content_of(folder / "itk.h5"));
  }
}

/// Where no file may grow beyond `most` bytes, which stands for the full disk: ends the process with 0 when that was an
/// error that names the file, and left nothing.
[[noreturn]] void write_on_full_disk(const std::filesystem::path& path, rlim_t most) {
  signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{most, most};
  setrlimit(RLIMIT_FSIZE, &limit);
  auto grid = oblique_grid<3>();
  grid.size = {40, 40, 40};
  try {
    write_transform(path, sample_vectors<3>(grid));
    _exit(1);
  } catch (const FileError& error) {
    const bool is_clean = std::filesystem::is_empty(path.parent_path());
    std::filesystem::remove_all(path.parent_path());
    _exit(!is_clean ? 2 : std::string(error.what()).starts_with("cannot write transform.h5: ") ? 0 : 3);
  }
}

TEST(WriteTransform, FullDiskIsAnErrorAndLeavesNothing) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");  // ITK has threads, which a bare fork would lose.
  const TemporaryFolder folder;
  for (rlim_t most : {0, 100, 3000, 20000, 500000})
    EXPECT_EXIT(write_on_full_disk(folder / "transform.h5", most), ::testing::ExitedWithCode(0), "") << most;
}

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
