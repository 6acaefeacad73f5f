#include "core/image_io/write_transform.h"

#include <itkCompositeTransform.h>
#include <itkDisplacementFieldTransform.h>
#include <itkHDF5TransformIO.h>

#include <string>

#include "core/image_io/itk_geometry.h"
#include "core/image_io/itk_lock.h"
#include "core/image_io/temporary_file.h"
#include "core/support/errors.h"

namespace saltus {

template <int Dim>
void write_transform(const std::filesystem::path& path, const VectorVolume<Dim>& displacement) {
  const std::string name = path.filename().string();
  if (!name.ends_with(".h5"))
    throw InvalidInput("transform file name '" + name + "' is not known; use a name that ends in .h5");
  const ImageGrid<Dim>& grid = displacement.grid;
  if (const auto found = problems(grid); !found.empty())
    throw InvalidInput("displacement for " + name + " cannot be written: " + found.front());
  if (displacement.samples.size() != Dim * grid.voxels())
    throw InvalidInput("displacement for " + name + " has " + std::to_string(displacement.samples.size()) +
                       " samples; its grid needs " + std::to_string(Dim * grid.voxels()));

  using FieldTransform = itk::DisplacementFieldTransform<float, Dim>;
  using Field = typename FieldTransform::DisplacementFieldType;
  TemporaryFile temporary(path);
  try {
    const std::lock_guard lock(itk_lock);
    const auto field = Field::New();
    set_geometry(*field, grid);
    field->Allocate();
    const std::size_t voxels = grid.voxels();
    for (int c = 0; c < Dim; ++c) {
      const float* plane = displacement.component(c);
      for (std::size_t i = 0; i < voxels; ++i) field->GetBufferPointer()[i][c] = plane[i];
    }
    const auto transform = FieldTransform::New();
    transform->SetDisplacementField(field);
    const auto composite = itk::CompositeTransform<float, Dim>::New();
    composite->AddTransform(transform);

    const auto io = itk::HDF5TransformIOTemplate<float>::New();
    typename itk::HDF5TransformIOTemplate<float>::ConstTransformListType list;
    list.push_back(composite.GetPointer());
    io->SetTransformList(list);
    io->SetFileName(temporary.path().string());
    io->Write();
  } catch (const itk::ExceptionObject& error) {
    throw FileError("cannot write " + name + ": " + error.GetDescription());
  }
  temporary.take_place();
}

template void write_transform(const std::filesystem::path&, const VectorVolume<2>&);
template void write_transform(const std::filesystem::path&, const VectorVolume<3>&);

}  // namespace saltus
