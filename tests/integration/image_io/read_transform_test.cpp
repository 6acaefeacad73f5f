// Oracle: ITK, which writes and reads the same files.
#include "core/image_io/read_transform.h"

#include <gmock/gmock.h>
#include <itkAffineTransform.h>
#include <itkCompositeTransform.h>
#include <itkDisplacementFieldTransform.h>
#include <itkHDF5TransformIO.h>
#include <itkTransformFactoryBase.h>
#include <itkTransformFileReader.h>
#include <itkTransformFileWriter.h>

#include <fstream>
#include <random>

#include "core/evaluation/field_sampling.h"
#include "core/image_io/itk_geometry.h"
#include "core/image_io/write_image.h"
#include "core/image_io/write_transform.h"
#include "core/registration/register_images.h"
#include "core/support/errors.h"
#include "tests/integration/image_io/sample_images.h"
#include "tests/support/analytic_scene.h"

namespace saltus {
namespace {

using testing::expect_same_place;
using ::testing::HasSubstr;
using testing::oblique_grid;
using testing::sample_vectors;
using testing::TemporaryFolder;

template <class Real, int Dim>
typename itk::Transform<Real, Dim, Dim>::Pointer read_by_itk(const std::filesystem::path& path) {
  using Reader = itk::TransformFileReaderTemplate<Real>;
  itk::TransformFactoryBase::RegisterDefaultTransforms();
  const auto reader = Reader::New();
  reader->SetTransformIO(itk::HDF5TransformIOTemplate<Real>::New());
  reader->SetFileName(path.string());
  reader->Update();
  return dynamic_cast<itk::Transform<Real, Dim, Dim>*>(reader->GetTransformList()->front().GetPointer());
}

template <class Real>
void write_by_itk(const std::filesystem::path& path, const itk::TransformBaseTemplate<Real>* transform) {
  const auto writer = itk::TransformFileWriterTemplate<Real>::New();
  writer->SetTransformIO(itk::HDF5TransformIOTemplate<Real>::New());
  writer->SetInput(transform);
  writer->SetFileName(path.string());
  writer->Update();
}

template <class Real, int Dim>
typename itk::DisplacementFieldTransform<Real, Dim>::Pointer to_itk(const VectorVolume<Dim>& displacement) {
  using Transform = itk::DisplacementFieldTransform<Real, Dim>;
  const auto field = Transform::DisplacementFieldType::New();
  set_geometry(*field, displacement.grid);
  field->Allocate();
  for (std::size_t i = 0; i < displacement.grid.voxels(); ++i)
    for (int c = 0; c < Dim; ++c) field->GetBufferPointer()[i][c] = displacement.component(c)[i];
  const auto transform = Transform::New();
  transform->SetDisplacementField(field);
  return transform;
}

template <int Dim>
void comes_back() {
  const TemporaryFolder folder;
  const VectorVolume<Dim> field = sample_vectors<Dim>();
  write_transform(folder / "transform.h5", field);
  EXPECT_EQ(displacement_dimension(folder / "transform.h5"), Dim);
  const VectorVolume<Dim> found = read_displacement<Dim>(folder / "transform.h5");
  expect_same_place(found.grid, field.grid, 1e-9);
  EXPECT_EQ(found.samples, field.samples);
  write_vector_volume(folder / "field.mha", field);
  EXPECT_EQ(displacement_dimension(folder / "field.mha"), Dim);
  EXPECT_EQ(read_displacement<Dim>(folder / "field.mha").samples, field.samples);
}

TEST(ReadTransform, GivesTheFieldThatWasWritten2d) { comes_back<2>(); }
TEST(ReadTransform, GivesTheFieldThatWasWritten3d) { comes_back<3>(); }

TEST(ReadTransform, TakesWhatItkWritesAloneAndInDoublePrecision) {
  const TemporaryFolder folder;
  const VectorVolume<3> field = sample_vectors<3>();
  write_by_itk<float>(folder / "alone.h5", to_itk<float, 3>(field));
  write_by_itk<double>(folder / "double.h5", to_itk<double, 3>(field));
  for (const char* name : {"alone.h5", "double.h5"}) {
    const VectorVolume<3> found = read_displacement<3>(folder / name);
    expect_same_place(found.grid, field.grid, 1e-9);
    EXPECT_EQ(found.samples, field.samples) << name;
  }
}

/// What a registration with an affine start found on oblique grids: ITK maps points as the field does, both ways.
template <int Dim>
void maps_as_the_registration_does(bool has_start) {
  const TemporaryFolder folder;
  const testing::AnalyticScene<Dim> scene(9, 3, 30, 5);
  Index<Dim> size;
  Vector<Dim> spacing;
  for (int axis = 0; axis < Dim; ++axis) size[axis] = 20 - 2 * axis, spacing[axis] = 1 + 0.25 * axis;
  const Matrix<Dim> turned = oblique_grid<Dim>().direction;
  AffineMap<Dim> start;
  if (has_start) {
    start.linear += 0.05 * turned;
    start.offset.setConstant(0.75);
  }
  RegistrationInput<Dim> input;
  input.fixed = testing::sampled<Dim>(testing::centred_grid<Dim>(size, spacing, turned), [&](const Vector<Dim>& x) {
    Vector<Dim> moved = start(x);
    moved[0] += 0.8 * std::sin(0.3 * x[1]);
    return scene(moved);
  });
  input.moving = testing::sampled<Dim>(testing::centred_grid<Dim>(size, spacing, turned.transpose()), scene);
  input.start = start;
  RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Fast);
  options.pyramid.finest_level = 0;
  options.optimisation.max_iterations = 8;
  const RegistrationResult<Dim> result = register_images<Dim>(input, options);

  for (const VectorVolume<Dim>* field : {&result.displacement, &result.inverse_displacement}) {
    SCOPED_TRACE(field == &result.displacement ? "forward" : "inverse");
    write_transform(folder / "transform.h5", *field);
    const auto transform = read_by_itk<double, Dim>(folder / "transform.h5");
    ASSERT_TRUE(transform);
    std::mt19937 generator(11);
    double largest = 0;
    for (int i = 0; i < 300; ++i) {
      Vector<Dim> index;
      for (int axis = 0; axis < Dim; ++axis)
        index[axis] = (0.01 + 0.98 * (generator() / 4294967296.0)) * (field->grid.size[axis] - 1);
      const Vector<Dim> world = field->grid.to_world(index), u = displacement_at(*field, world);
      itk::Point<double, Dim> point;
      for (int axis = 0; axis < Dim; ++axis) point[axis] = world[axis];
      const auto mapped = transform->TransformPoint(point);
      // Samples are floats and equal; what differs is rounding in the weights and the sum.
      for (int axis = 0; axis < Dim; ++axis) ASSERT_NEAR(mapped[axis], world[axis] + u[axis], 1e-6);
      largest = std::max(largest, u.norm());
    }
    EXPECT_GT(largest, has_start ? 1.0 : 0.3);  // there is something to map
  }
}

TEST(ReadTransform, ItkMapsAsTheRegistrationDoes2d) { maps_as_the_registration_does<2>(false); }
TEST(ReadTransform, ItkMapsAsTheRegistrationDoes3d) { maps_as_the_registration_does<3>(false); }
TEST(ReadTransform, ItkMapsAsTheRegistrationDoesAfterAnAffineStart2d) { maps_as_the_registration_does<2>(true); }
TEST(ReadTransform, ItkMapsAsTheRegistrationDoesAfterAnAffineStart3d) { maps_as_the_registration_does<3>(true); }

template <int Dim>
std::string refusal(const std::filesystem::path& path) {
  try {
    read_displacement<Dim>(path);
  } catch (const FileError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ReadTransform, RefusesOtherTransformsByName) {
  const TemporaryFolder folder;
  EXPECT_EQ(refusal<3>(folder / "absent.h5"), "cannot read absent.h5: there is no such file");
  EXPECT_THROW(displacement_dimension(folder / "absent.h5"), FileError);

  write_by_itk<float>(folder / "affine.h5", itk::AffineTransform<float, 3>::New());
  EXPECT_THAT(refusal<3>(folder / "affine.h5"), HasSubstr("AffineTransform; a displacement field is needed"));

  const VectorVolume<3> field = sample_vectors<3>();
  const auto both = itk::CompositeTransform<float, 3>::New();
  both->AddTransform(itk::AffineTransform<float, 3>::New());
  both->AddTransform(to_itk<float, 3>(field));
  write_by_itk<float>(folder / "both.h5", both);
  EXPECT_THAT(refusal<3>(folder / "both.h5"), HasSubstr("2 transforms; give a file with one displacement field"));

  write_transform(folder / "transform.h5", field);
  EXPECT_THAT(refusal<2>(folder / "transform.h5"), HasSubstr("3-D transform where a 2-D one is needed"));
}

TEST(ReadTransform, RefusesDamagedFiles) {
  const TemporaryFolder folder;
  write_transform(folder / "transform.h5", sample_vectors<3>());
  std::ifstream in(folder / "transform.h5", std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(in), {}};
  ASSERT_GT(whole.size(), 1000u);
  for (std::size_t length : {std::size_t(0), std::size_t(7), std::size_t(100), whole.size() / 2, whole.size() - 1}) {
    std::ofstream(folder / "cut.h5", std::ios::binary) << whole.substr(0, length);
    EXPECT_THAT(refusal<3>(folder / "cut.h5"), HasSubstr("cannot read cut.h5: ")) << length;
  }
  std::ofstream(folder / "text.h5") << "no HDF5 at all";
  EXPECT_THAT(refusal<3>(folder / "text.h5"), HasSubstr("cannot read text.h5: "));
}

}  // namespace
}  // namespace saltus
