#include "core/image_io/image_file.h"

#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <itkPNGImageIO.h>
#include <nifti1_io.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <memory>
#include <sstream>
#include <string>

#include "core/image_io/interleaved.h"
#include "core/image_io/itk_lock.h"
#include "core/image_io/lone_name.h"
#include "core/image_io/meta_header.h"
#include "core/image_io/nifti_header.h"
#include "core/image_io/nrrd_header.h"
#include "core/image_io/output_stream.h"
#include "core/image_io/payload_check.h"
#include "core/image_io/png_chunks.h"
#include "core/image_io/refuse_file.h"
#include "core/image_io/temporary_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

itk::ImageIOBase::Pointer make_image_io(ImageFormat format) {
  switch (format) {
    case ImageFormat::MetaImage:
      return itk::MetaImageIO::New().GetPointer();
    case ImageFormat::Nifti:
    case ImageFormat::CompressedNifti:
      return itk::NiftiImageIO::New().GetPointer();
    case ImageFormat::Nrrd:
      return itk::NrrdImageIO::New().GetPointer();
    case ImageFormat::Png:
      return itk::PNGImageIO::New().GetPointer();
  }
  throw InvalidInput("image format " + std::to_string(static_cast<int>(format)) + " does not exist");
}

/// What ITK says of the file at `path`, on one line, without its class and address prefix, and with its name alone.
std::string reason(const itk::ExceptionObject& error, const std::filesystem::path& path, const std::string& name) {
  std::string text = error.GetDescription();
  if (const auto prefix = text.find("): ");
      (text.starts_with("itk::ERROR") || text.starts_with("ITK ERROR")) && prefix != std::string::npos)
    text.erase(0, prefix + 3);
  const std::string full = path.string();
  // Not from where it was found: the name of a file in the current folder is its whole path.
  for (auto at = text.find(full); at != std::string::npos; at = text.find(full, at + name.size()))
    text.replace(at, full.size(), name);
  std::string line;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (!line.empty()) line += ' ';
    line += word;
  }
  return line;
}

/// From what is stored to what it means.
struct Scaling {
  double slope = 1;
  double intercept = 0;

  bool is_none() const { return slope == 1 && intercept == 0; }
  template <typename Sample>
  float operator()(Sample stored) const {
    return static_cast<float>(slope * static_cast<double>(stored) + intercept);
  }
};

struct OpenedImage {
  std::unique_ptr<LoneName> name;  ///< of a NIfTI file
  itk::ImageIOBase::Pointer io;    ///< its component type is the stored one
  Scaling scaling;
  ImageFileHeader header;
  std::size_t voxels = 0;
  std::uintmax_t data_offset = 0;  ///< where the voxels begin, in the decompressed .nii.gz; 0 in a PNG
  bool is_gzip_nrrd = false;
  MetaHeader meta;  ///< of a MetaImage
};

std::string dimension_text(const itk::ImageIOBase& io) {
  std::string text;
  for (unsigned axis = 0; axis < io.GetNumberOfDimensions(); ++axis) {
    if (axis > 0) text += 'x';
    text += std::to_string(io.GetDimensions(axis));
  }
  return text;
}

/// Has ITK pass on what is stored. It scales no more than the first of several components, and writes past the end of
/// its memory when it makes floats of integers that are several components.
void take_stored_voxels(itk::NiftiImageIO& io, int datatype) {
  using Type = itk::IOComponentEnum;
  io.SetRescaleSlope(1);
  io.SetRescaleIntercept(0);
  // It has announced floats for the integers that it would have scaled.
  switch (datatype) {
    case NIFTI_TYPE_INT8:
      return io.SetComponentType(Type::CHAR);
    case NIFTI_TYPE_UINT8:
    case NIFTI_TYPE_RGB24:
    case NIFTI_TYPE_RGBA32:
      return io.SetComponentType(Type::UCHAR);
    case NIFTI_TYPE_INT16:
      return io.SetComponentType(Type::SHORT);
    case NIFTI_TYPE_UINT16:
      return io.SetComponentType(Type::USHORT);
    case NIFTI_TYPE_INT32:
      return io.SetComponentType(Type::INT);
    case NIFTI_TYPE_UINT32:
      return io.SetComponentType(Type::UINT);
    case NIFTI_TYPE_INT64:
      return io.SetComponentType(Type::LONGLONG);
    case NIFTI_TYPE_UINT64:
      return io.SetComponentType(Type::ULONGLONG);
    default:
      return;
  }
}

/// Reads the header and refuses what must not reach the voxels.
OpenedImage open_image(const std::filesystem::path& path) {
  const ImageFormat format = format_from_suffix(path);
  std::error_code error;
  if (!std::filesystem::exists(path, error)) refuse(path, "there is no such file");
  if (!std::filesystem::is_regular_file(path, error)) refuse(path, "it is not a regular file");
  const std::uintmax_t file_size = std::filesystem::file_size(path, error);
  if (error) refuse(path, error.message());

  OpenedImage image;
  bool is_raw = format == ImageFormat::Nifti;
  if (format == ImageFormat::Nrrd) {
    const NrrdHeader nrrd = read_nrrd_header(path);
    is_raw = nrrd.is_raw;
    image.is_gzip_nrrd = nrrd.is_gzip;
    image.data_offset = nrrd.data_offset;
  }
  if (format == ImageFormat::MetaImage) {
    image.meta = read_meta_header(path);
    image.data_offset = image.meta.data_offset;
    is_raw = !image.meta.is_compressed && !image.meta.is_text;
  }
  if (format == ImageFormat::Png) check_png_chunks(path);
  NiftiHeader nifti;
  const bool is_nifti = format == ImageFormat::Nifti || format == ImageFormat::CompressedNifti;
  if (is_nifti) {
    nifti = read_nifti_header(path);
    image.name = std::make_unique<LoneName>(path);
    image.data_offset = nifti.data_offset;
    image.scaling = {nifti.slope, nifti.intercept};
  }

  image.io = make_image_io(format);
  if (!image.io->CanReadFile(path.c_str())) refuse(path, "its content is not what its name promises");
  image.io->SetFileName((is_nifti ? image.name->path() : path).string());
  image.io->ReadImageInformation();
  if (is_nifti) take_stored_voxels(static_cast<itk::NiftiImageIO&>(*image.io), nifti.datatype);
  const int io_dimension = image.io->GetNumberOfDimensions();
  ImageFileHeader& header = image.header;
  header.dimension = is_nifti ? nifti.dimension : io_dimension;
  for (int axis = io_dimension - 1; axis >= 3 && image.io->GetDimensions(axis) == 1; --axis)
    header.dimension = std::min(header.dimension, axis);
  if (header.dimension < 2 || header.dimension > 3)
    refuse(path, "it has " + std::to_string(header.dimension) + " dimensions (" + dimension_text(*image.io) +
                     "); use a 2-D or 3-D image");

  image.voxels = 1;
  constexpr std::size_t most_voxels = std::size_t{1} << 31;
  for (int axis = 0; axis < header.dimension; ++axis) {
    header.size[axis] = axis < io_dimension ? image.io->GetDimensions(axis) : 1;
    if (header.size[axis] < 1 || header.size[axis] > most_voxels / image.voxels)
      refuse(path, "its size " + dimension_text(*image.io) + " is not between 1 and 2^31 voxels");
    image.voxels *= header.size[axis];
    if (axis >= io_dimension) continue;
    header.spacing[axis] = image.io->GetSpacing(axis);
    header.origin[axis] = image.io->GetOrigin(axis);
    const auto direction = image.io->GetDirection(axis);
    for (int row = 0; row < std::min(header.dimension, io_dimension); ++row)
      header.direction[axis][row] = direction[row];
  }
  // ITK reads every axis that it has found, into memory for those that we count.
  for (int axis = header.dimension; axis < io_dimension; ++axis)
    if (image.io->GetDimensions(axis) != 1)
      refuse(path, "its size " + dimension_text(*image.io) + " has more than " + std::to_string(header.dimension) +
                       " axes; use a 2-D or 3-D image");
  // ITK drops the third axis of a NIfTI file of one slice.
  if (io_dimension < header.dimension) {
    const NiftiPlacement placement = read_nifti_placement(path);
    header.spacing = placement.spacing;
    header.origin = placement.origin;
    header.direction = placement.direction;
  }
  header.components = image.io->GetNumberOfComponents();
  if (image.io->GetPixelType() == itk::IOPixelEnum::COMPLEX) refuse(path, "its voxels are complex numbers");
  if (header.components < 1 || header.components > 16)
    refuse(path, "it has " + std::to_string(header.components) + " components a voxel");

  // What was allowed by our reading of the header must be what ITK has found in it.
  if (format == ImageFormat::MetaImage &&
      image.voxels * header.components * image.io->GetComponentSize() != image.meta.voxel_bytes)
    refuse(path, "its header can be read in two ways");

  // Deflate cannot make anything smaller than by a factor of 1032.
  const std::uintmax_t stored = file_size - (is_raw ? std::min(image.data_offset, file_size) : 0);
  const std::uintmax_t most_bytes = is_raw ? stored : 1032 * stored;
  if (image.voxels * header.components > most_bytes / image.io->GetComponentSize())
    refuse(path, "its header promises " + dimension_text(*image.io) + " voxels, more than its " +
                     std::to_string(file_size) + " bytes can hold; it is cut off or damaged");
  if (format == ImageFormat::Png && (header.components == 2 || header.components == 4))
    refuse(path, "it has a transparency channel; save it without");
  return image;
}

/// Whole image as ITK's region of interest.
itk::ImageIORegion whole(const itk::ImageIOBase& io) {
  itk::ImageIORegion region(io.GetNumberOfDimensions());
  for (unsigned axis = 0; axis < io.GetNumberOfDimensions(); ++axis) {
    region.SetIndex(axis, 0);
    region.SetSize(axis, io.GetDimensions(axis));
  }
  return region;
}

/// Has ITK write all voxels into `stored`, which must be as long as what it writes: it does not look.
template <typename Sample>
void read_stored(itk::ImageIOBase& io, std::vector<Sample>& stored) {
  const auto written = static_cast<std::uintmax_t>(io.GetImageSizeInBytes());
  if (written != stored.size() * sizeof(Sample))
    refuse(io.GetFileName(), "its header promises " + std::to_string(written) +
                                 " bytes of voxels where its size makes " +
                                 std::to_string(stored.size() * sizeof(Sample)) + "; it is damaged");
  io.SetIORegion(whole(io));
  io.Read(stored.data());
}

template <typename Sample>
void read_samples(itk::ImageIOBase& io, const Scaling& scaling, std::vector<float>& samples) {
  std::vector<Sample> stored(samples.size());
  read_stored(io, stored);
  if (scaling.is_none())
    std::transform(stored.begin(), stored.end(), samples.begin(), [](Sample one) { return static_cast<float>(one); });
  else
    std::transform(stored.begin(), stored.end(), samples.begin(), scaling);
}

void read_any_samples(itk::ImageIOBase& io, const Scaling& scaling, std::vector<float>& samples) {
  using Type = itk::IOComponentEnum;
  switch (io.GetComponentType()) {
    case Type::FLOAT:
      read_stored(io, samples);
      if (!scaling.is_none()) std::transform(samples.begin(), samples.end(), samples.begin(), scaling);
      return;
    case Type::DOUBLE:
      return read_samples<double>(io, scaling, samples);
    case Type::UCHAR:
      return read_samples<unsigned char>(io, scaling, samples);
    case Type::CHAR:
      return read_samples<signed char>(io, scaling, samples);
    case Type::USHORT:
      return read_samples<unsigned short>(io, scaling, samples);
    case Type::SHORT:
      return read_samples<short>(io, scaling, samples);
    case Type::UINT:
      return read_samples<unsigned int>(io, scaling, samples);
    case Type::INT:
      return read_samples<int>(io, scaling, samples);
    case Type::ULONG:
      return read_samples<unsigned long>(io, scaling, samples);
    case Type::LONG:
      return read_samples<long>(io, scaling, samples);
    case Type::ULONGLONG:
      return read_samples<unsigned long long>(io, scaling, samples);
    case Type::LONGLONG:
      return read_samples<long long>(io, scaling, samples);
    default:
      throw FileError("cannot read " + std::filesystem::path(io.GetFileName()).filename().string() +
                      ": its voxels are of the type " + io.GetComponentTypeAsString(io.GetComponentType()) +
                      ", which is not supported");
  }
}

void to_luminance(ImageFile& image) {
  const std::size_t pixels = image.samples.size() / 3;
  for (std::size_t i = 0; i < pixels; ++i) {
    const float* rgb = image.samples.data() + 3 * i;
    image.samples[i] = static_cast<float>((2125.0 * rgb[0] + 7154.0 * rgb[1] + 721.0 * rgb[2]) / 10000.0);
  }
  image.samples.resize(pixels);
  image.header.components = 1;
}

/// Has ITK write `samples`, component fastest, as the whole file at `path`, which errors call `name`.
void write_with_itk(const std::filesystem::path& path, const std::string& name, ImageFormat format,
                    const ImageFileHeader& header, itk::IOComponentEnum component_type, const void* samples) try {
  const std::lock_guard lock(itk_lock);
  const auto io = make_image_io(format);
  if (format == ImageFormat::MetaImage) static_cast<itk::MetaImageIO&>(*io).SetDoublePrecision(17);
  io->SetFileName(path.string());
  io->SetNumberOfDimensions(header.dimension);
  for (int axis = 0; axis < header.dimension; ++axis) {
    io->SetDimensions(axis, header.size[axis]);
    io->SetSpacing(axis, header.spacing[axis]);
    io->SetOrigin(axis, header.origin[axis]);
    const auto& direction = header.direction[axis];
    io->SetDirection(axis, std::vector<double>(direction.begin(), direction.begin() + header.dimension));
  }
  io->SetNumberOfComponents(header.components);
  io->SetPixelType(header.components == 1 ? itk::IOPixelEnum::SCALAR : itk::IOPixelEnum::VECTOR);
  io->SetComponentType(component_type);
  io->SetUseCompression(format == ImageFormat::Png);
  io->SetIORegion(whole(*io));
  io->Write(samples);
} catch (const itk::ExceptionObject& error) {
  throw FileError("cannot write " + name + ": " + reason(error, path, name));
}

/// Everything before the voxels in a file that ends with them.
std::vector<char> read_head(const std::filesystem::path& path, std::size_t voxel_bytes) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error || size <= voxel_bytes) throw FileError("too short");
  std::vector<char> head(size - voxel_bytes);
  std::ifstream input(path, std::ios::binary);
  if (!input.read(head.data(), static_cast<std::streamsize>(head.size()))) throw FileError("too short");
  return head;
}

/// Puts the true sizes into the only line of a text header that begins with `key`.
void replace_sizes(std::vector<char>& head, const std::string& key, const std::string& sizes) {
  const std::string text(head.begin(), head.end());
  const auto begin = text.find("\n" + key) + 1, end = text.find('\n', begin);
  if (begin == 0 || end == std::string::npos) throw FileError("no sizes in its header");
  const std::string now = text.substr(0, begin) + key + sizes + text.substr(end);
  head.assign(now.begin(), now.end());
}

/// Everything before the voxels: what ITK writes for an image of at most two voxels an axis in the same place, with the
/// true sizes put in. Throws InvalidInput for sizes that NIfTI has no room for.
template <typename Sample>
std::vector<char> head_of(const std::filesystem::path& path, ImageFormat format, const ImageFileHeader& header,
                          itk::IOComponentEnum component_type) {
  const std::string name = path.filename().string();
  const bool is_nifti = format == ImageFormat::Nifti || format == ImageFormat::CompressedNifti;
  ImageFileHeader small = header;
  std::string sizes;
  for (int axis = 0; axis < header.dimension; ++axis) {
    if (is_nifti && header.size[axis] > std::numeric_limits<std::int16_t>::max())
      throw InvalidInput("image for " + name + " has " + std::to_string(header.size[axis]) +
                         " voxels along an axis; NIfTI has room for 32767, use .mha");
    small.size[axis] = std::min<std::size_t>(header.size[axis], 2);
    sizes += (axis > 0 ? " " : "") + std::to_string(header.size[axis]);
  }
  const std::vector<Sample> samples(8 * static_cast<std::size_t>(header.components));
  const std::size_t voxels = small.size[0] * small.size[1] * (header.dimension == 3 ? small.size[2] : 1);
  // ITK takes the suffix as it is written here.
  const char* suffix = is_nifti ? ".nii" : format == ImageFormat::MetaImage ? ".mha" : ".nrrd";
  TemporaryFile file(path.parent_path() / (path.stem().stem().string() + suffix));
  write_with_itk(file.path(), name, is_nifti ? ImageFormat::Nifti : format, small, component_type, samples.data());
  try {
    std::vector<char> head =
        read_head(file.path(), voxels * static_cast<std::size_t>(header.components) * sizeof(Sample));
    if (format == ImageFormat::MetaImage) replace_sizes(head, "DimSize = ", sizes);
    if (format == ImageFormat::Nrrd)
      replace_sizes(head, "sizes: ", (header.components > 1 ? std::to_string(header.components) + " " : "") + sizes);
    for (int axis = 0; is_nifti && axis < header.dimension; ++axis) {
      const auto size = static_cast<std::int16_t>(header.size[axis]);
      std::memcpy(head.data() + kNiftiSizes + sizeof size * static_cast<std::size_t>(axis), &size, sizeof size);
    }
    return head;
  } catch (const FileError&) {  // ITK does not notice what it could not write
    throw FileError("cannot write " + name + ": is the disk full, or its folder write-protected?");
  }
}

template <typename Sample>
void write_after_head(const std::filesystem::path& path, ImageFormat format, const ImageFileHeader& header,
                      std::span<const Sample> samples, itk::IOComponentEnum component_type) {
  const std::vector<char> head = head_of<Sample>(path, format, header, component_type);
  TemporaryFile file(path);
  const bool is_packed = format == ImageFormat::CompressedNifti;
  OutputStream output(file.path(), is_packed ? OutputStream::Packing::Gzip : OutputStream::Packing::Plain,
                      path.filename().string());
  output.write(head);
  if (header.components > 1 && (format == ImageFormat::MetaImage || format == ImageFormat::Nrrd))
    for_interleaved(samples, static_cast<std::size_t>(header.components),
                    [&](std::span<const char> bytes) { output.write(bytes); });
  else
    output.write({reinterpret_cast<const char*>(samples.data()), samples.size_bytes()});
  output.finish();
  file.take_place();
}

template <typename Sample>
void write_png(const std::filesystem::path& path, const ImageFileHeader& header, std::span<const Sample> samples,
               itk::IOComponentEnum component_type) {
  const std::string name = path.filename().string();
  TemporaryFile file(path);
  write_with_itk(file.path(), name, ImageFormat::Png, header, component_type, samples.data());
  std::error_code error;
  if (!std::filesystem::exists(file.path(), error) || error)
    throw FileError("cannot write " + name + ": is the disk full, or its folder write-protected?");
  file.take_place();
}

template <typename Sample>
void write_any(const std::filesystem::path& path, const ImageFileHeader& header, std::span<const Sample> samples,
               itk::IOComponentEnum component_type) {
  const ImageFormat format = format_from_suffix(path);
  if (format == ImageFormat::Png)
    write_png(path, header, samples, component_type);
  else
    write_after_head(path, format, header, samples, component_type);
}

}  // namespace

ImageFileHeader read_image_header(const std::filesystem::path& path) {
  try {
    ImageFileHeader header = open_image(path).header;
    if (format_from_suffix(path) == ImageFormat::Png) header.components = 1;
    return header;
  } catch (const itk::ExceptionObject& error) {
    refuse(path, reason(error, path, path.filename().string()));
  }
}

ImageFile read_image_file(const std::filesystem::path& path) {
  try {
    const OpenedImage opened = open_image(path);
    const std::uintmax_t bytes = opened.voxels * opened.header.components * opened.io->GetComponentSize();
    if (opened.meta.is_compressed)
      check_compressed_payload(path, opened.data_offset, bytes, opened.meta.compressed_bytes);
    if (opened.is_gzip_nrrd) check_compressed_payload(path, opened.data_offset, bytes);
    if (opened.meta.is_text)
      check_text_payload(path, opened.data_offset, opened.voxels * static_cast<std::size_t>(opened.header.components));
    if (format_from_suffix(path) == ImageFormat::CompressedNifti)
      check_compressed_payload(path, 0, opened.data_offset + bytes);
    ImageFile image{opened.header, std::vector<float>(opened.voxels * opened.header.components)};
    read_any_samples(*opened.io, opened.scaling, image.samples);
    if (format_from_suffix(path) == ImageFormat::Png && image.header.components == 3) to_luminance(image);
    return image;
  } catch (const itk::ExceptionObject& error) {
    refuse(path, reason(error, path, path.filename().string()));
  }
}

void write_image_file(const std::filesystem::path& path, const ImageFileHeader& header,
                      std::span<const float> samples) {
  write_any(path, header, samples, itk::IOComponentEnum::FLOAT);
}

void write_image_file(const std::filesystem::path& path, const ImageFileHeader& header,
                      std::span<const std::uint8_t> samples) {
  write_any(path, header, samples, itk::IOComponentEnum::UCHAR);
}

}  // namespace saltus
