#include "core/image_io/read_transform.h"

#include <itkDisplacementFieldTransform.h>
#include <itkHDF5TransformIO.h>

#include <limits>
#include <new>
#include <string>

#include "core/image_io/nearest_rotation.h"
#include "core/image_io/read_image.h"
#include "core/image_io/refuse_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

using TransformIo = itk::HDF5TransformIOTemplate<float>;
using AnyTransform = itk::TransformBaseTemplate<float>;

bool is_transform_file(const std::filesystem::path& path) { return path.extension() == ".h5"; }

/// Keeps what was read alive.
class TransformFile {
 public:
  explicit TransformFile(const std::filesystem::path& path) : io_(TransformIo::New()) {
    if (!std::filesystem::exists(path)) refuse(path, "there is no such file");
    try {
      io_->SetFileName(path.string());
      if (!io_->CanReadFile(path.string().c_str())) refuse(path, "it is no HDF5 file");
      io_->Read();
    } catch (const itk::ExceptionObject& error) {
      refuse(path, std::string("it is damaged or holds no transform that ITK knows (") + error.GetDescription() + ")");
    } catch (const std::bad_alloc&) {
      refuse(path, "it promises more than fits into memory");
    } catch (const FileError&) {
      throw;
    } catch (...) {  // HDF5's own exceptions derive from nothing
      refuse(path, "HDF5 cannot read it; it may be damaged");
    }
    if (list().empty()) refuse(path, "it holds no transform");
    // A composite is stored empty, followed by its parts.
    const bool is_composite = std::string(list().front()->GetNameOfClass()) == "CompositeTransform";
    const std::size_t parts = list().size() - (is_composite ? 1 : 0);
    if (parts != 1)
      refuse(path, "it holds " + std::to_string(parts) + " transforms; give a file with one displacement field");
  }

  int dimension() const { return static_cast<int>(transform()->GetInputSpaceDimension()); }
  const AnyTransform* transform() const { return list().back(); }

 private:
  const TransformIo::TransformListType& list() const { return io_->GetReadTransformList(); }

  TransformIo::Pointer io_;
};

}  // namespace

int displacement_dimension(const std::filesystem::path& path) {
  if (!is_transform_file(path)) return image_dimension(path);
  const int dimension = TransformFile(path).dimension();
  if (dimension != 2 && dimension != 3)
    refuse(path, "it is a " + std::to_string(dimension) + "-D transform; 2 and 3 dimensions are understood");
  return dimension;
}

template <int Dim>
VectorVolume<Dim> read_displacement(const std::filesystem::path& path) {
  if (!is_transform_file(path)) return read_vector_volume<Dim>(path);
  const TransformFile file(path);
  if (file.dimension() != Dim)
    refuse(path, "it is a " + std::to_string(file.dimension()) + "-D transform where a " + std::to_string(Dim) +
                     "-D one is needed");
  using FieldTransform = itk::DisplacementFieldTransform<float, Dim>;
  const auto* transform = dynamic_cast<const FieldTransform*>(file.transform());
  if (!transform)
    refuse(path, std::string("it holds a ") + file.transform()->GetNameOfClass() + "; a displacement field is needed");
  const auto* field = transform->GetDisplacementField();
  if (!field) refuse(path, "its displacement field is empty");

  ImageGrid<Dim> grid;
  const auto size = field->GetLargestPossibleRegion().GetSize();
  for (int axis = 0; axis < Dim; ++axis) {
    if (size[axis] > static_cast<std::size_t>(std::numeric_limits<int>::max()))
      refuse(path, "axis " + std::to_string(axis) + " has " + std::to_string(size[axis]) + " voxels");
    grid.size[axis] = static_cast<int>(size[axis]);
    grid.spacing[axis] = field->GetSpacing()[axis];
    grid.origin[axis] = field->GetOrigin()[axis];
    for (int row = 0; row < Dim; ++row) grid.direction(row, axis) = field->GetDirection()(row, axis);
  }
  if (const auto found = problems(grid, kRoundedDirection); !found.empty()) refuse(path, found.front());
  grid.direction = nearest_rotation<Dim>(grid.direction);
  VectorVolume<Dim> displacement(grid);
  const std::size_t voxels = grid.voxels();
  for (int c = 0; c < Dim; ++c) {
    float* plane = displacement.component(c);
    for (std::size_t i = 0; i < voxels; ++i) plane[i] = field->GetBufferPointer()[i][c];
  }
  return displacement;
}

template VectorVolume<2> read_displacement<2>(const std::filesystem::path&);
template VectorVolume<3> read_displacement<3>(const std::filesystem::path&);

}  // namespace saltus
