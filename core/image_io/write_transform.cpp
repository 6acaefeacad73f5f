#include "core/image_io/write_transform.h"

#include <itkCompositeTransform.h>
#include <itkDisplacementFieldTransform.h>
#include <itkHDF5TransformIO.h>

#include <itk_hdf5.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "core/image_io/interleaved.h"
#include "core/image_io/itk_geometry.h"
#include "core/image_io/itk_lock.h"
#include "core/image_io/output_stream.h"
#include "core/image_io/temporary_file.h"
#include "core/support/errors.h"

namespace saltus {

namespace {

/// Closes what HDF5 has opened.
class Handle {
 public:
  using Close = herr_t (*)(hid_t);
  Handle(hid_t id, Close close) : id_(id), close_(close) {
    if (id < 0) throw FileError("not what ITK should have written");
  }
  ~Handle() { close_(id_); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  operator hid_t() const { return id_; }  // NOLINT: it is one to HDF5

 private:
  hid_t id_;
  Close close_;
};

/// HDF5 prints errors unless told otherwise.
class QuietHdf5 {
 public:
  QuietHdf5() {
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~QuietHdf5() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
  QuietHdf5(const QuietHdf5&) = delete;
  QuietHdf5& operator=(const QuietHdf5&) = delete;

 private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

constexpr const char* kPlace = "/TransformGroup/1/TransformFixedParameters";
constexpr const char* kField = "/TransformGroup/1/TransformParameters";

/// Has ITK write a composite of one displacement field, all 0, on `grid`.
template <int Dim>
void write_with_itk(const std::filesystem::path& path, const ImageGrid<Dim>& grid) {
  using FieldTransform = itk::DisplacementFieldTransform<float, Dim>;
  const auto field = FieldTransform::DisplacementFieldType::New();
  set_geometry(*field, grid);
  field->Allocate(true);
  const auto transform = FieldTransform::New();
  transform->SetDisplacementField(field);
  const auto composite = itk::CompositeTransform<float, Dim>::New();
  composite->AddTransform(transform);

  const auto io = itk::HDF5TransformIOTemplate<float>::New();
  typename itk::HDF5TransformIOTemplate<float>::ConstTransformListType list;
  list.push_back(composite.GetPointer());
  io->SetTransformList(list);
  io->SetFileName(path.string());
  io->Write();
}

/// Makes room in that file for a field of this size. Where its first byte lies.
template <int Dim>
std::uint64_t make_room(const std::filesystem::path& path, const std::array<int, Dim>& size, std::size_t values) {
  const QuietHdf5 quiet;
  const Handle file(H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
  {
    const Handle place(H5Dopen2(file, kPlace, H5P_DEFAULT), H5Dclose);
    const Handle space(H5Dget_space(place), H5Sclose);
    // Size, origin, spacing, direction.
    std::array<double, Dim*(3 + Dim)> numbers;
    if (H5Sget_simple_extent_npoints(space) != static_cast<hssize_t>(numbers.size()) ||
        H5Dread(place, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) < 0)
      throw FileError("not what ITK should have written");
    std::copy(size.begin(), size.end(), numbers.begin());
    if (H5Dwrite(place, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) < 0)
      throw FileError("cannot be written");
  }
  if (H5Ldelete(file, kField, H5P_DEFAULT) < 0) throw FileError("not what ITK should have written");
  const hsize_t count = values;
  const Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
  const Handle layout(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_layout(layout, H5D_CONTIGUOUS);
  H5Pset_alloc_time(layout, H5D_ALLOC_TIME_EARLY);
  H5Pset_fill_time(layout, H5D_FILL_TIME_NEVER);
  const Handle field(H5Dcreate2(file, kField, H5T_NATIVE_FLOAT, space, H5P_DEFAULT, layout, H5P_DEFAULT), H5Dclose);
  const haddr_t offset = H5Dget_offset(field);
  if (offset == HADDR_UNDEF || H5Fflush(file, H5F_SCOPE_GLOBAL) < 0) throw FileError("cannot be written");
  return offset;
}

/// The whole file but for the vectors, and where their first byte belongs. ITK makes it for two voxels an axis in the
/// same place: of a large field it would make copies, and nobody else could write meanwhile.
template <int Dim>
std::uint64_t write_without_vectors(const std::filesystem::path& path, const std::string& name,
                                    const ImageGrid<Dim>& grid) try {
  ImageGrid<Dim> small = grid;
  for (int axis = 0; axis < Dim; ++axis) small.size[axis] = std::min(grid.size[axis], 2);
  const std::lock_guard lock(itk_lock);
  write_with_itk(path, small);
  return make_room<Dim>(path, grid.size, Dim * grid.voxels());
} catch (const itk::ExceptionObject& error) {
  throw FileError("cannot write " + name + ": " + error.GetDescription());
} catch (const FileError& error) {
  throw FileError("cannot write " + name + ": " + error.what());
}

}  // namespace

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

  TemporaryFile temporary(path);
  const std::uint64_t offset = write_without_vectors(temporary.path(), name, grid);
  OutputStream output(temporary.path(), OutputStream::Packing::Plain, name, offset);
  for_interleaved(std::span(displacement.samples), Dim, [&](std::span<const char> bytes) { output.write(bytes); });
  output.finish();
  temporary.take_place();
}

template void write_transform(const std::filesystem::path&, const VectorVolume<2>&);
template void write_transform(const std::filesystem::path&, const VectorVolume<3>&);

}  // namespace saltus
