#include "core/image_io/nifti_header.h"

#include <nifti1_io.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>

#include "core/image_io/refuse_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

bool use_nifti_sform(const nifti_image& image) {
  return image.sform_code != NIFTI_XFORM_UNKNOWN &&
         (image.sform_code == NIFTI_XFORM_SCANNER_ANAT || image.qform_code == NIFTI_XFORM_UNKNOWN);
}

/// The first bytes of a header, in the byte order of this machine when they are taken out.
class HeaderBytes {
 public:
  static constexpr std::size_t size = 348;

  char* data() { return bytes_.data(); }
  void swap_from_now_on() { is_swapped_ = true; }

  std::uint16_t short_at(std::size_t offset) const {
    std::uint16_t bits = 0;
    std::memcpy(&bits, bytes_.data() + offset, sizeof bits);
    return is_swapped_ ? __builtin_bswap16(bits) : bits;
  }
  int integer_at(std::size_t offset) const { return static_cast<std::int16_t>(short_at(offset)); }
  std::uint32_t word_at(std::size_t offset) const { return swapped(offset); }
  float number_at(std::size_t offset) const { return std::bit_cast<float>(swapped(offset)); }
  bool has_at(std::size_t offset, std::string_view text) const {
    return std::string_view(bytes_.data() + offset, text.size()) == text;
  }

 private:
  std::uint32_t swapped(std::size_t offset) const {
    std::uint32_t bits = 0;
    std::memcpy(&bits, bytes_.data() + offset, sizeof bits);
    return is_swapped_ ? __builtin_bswap32(bits) : bits;
  }

  std::array<char, size> bytes_{};
  bool is_swapped_ = false;
};

// Where the fields are.
constexpr std::size_t kDimensions = kNiftiSizes - 2, kIntentCode = 68, kDatatype = 70, kSpacing = 76, kDataOffset = 108,
                      kSlope = 112, kIntercept = 116, kQformCode = 252, kSformCode = 254, kQuaternion = 256,
                      kSform = 280, kMagic = 344;
constexpr std::size_t kQuaternionNumbers = 6, kSformNumbers = 12;
/// No place in millimetres is further away; ITK's matrices overflow at values that are.
constexpr float kFarthest = 1e9F;
/// Header and extensions; the library takes memory for these before it looks whether they are there.
constexpr std::size_t kLongestNifti = std::size_t{64} << 20, kExtender = 348, kFirstExtension = 352;

bool is_real(int datatype) {
  switch (datatype) {
    case NIFTI_TYPE_INT8:
    case NIFTI_TYPE_UINT8:
    case NIFTI_TYPE_INT16:
    case NIFTI_TYPE_UINT16:
    case NIFTI_TYPE_INT32:
    case NIFTI_TYPE_UINT32:
    case NIFTI_TYPE_INT64:
    case NIFTI_TYPE_UINT64:
    case NIFTI_TYPE_FLOAT32:
    case NIFTI_TYPE_FLOAT64:
      return true;
    default:
      return false;
  }
}

/// The type of voxels, and the axes in space and of components.
void read_axes(const std::filesystem::path& path, const HeaderBytes& header, NiftiHeader& result) {
  std::array<int, 8> dim{};
  for (std::size_t i = 0; i < dim.size(); ++i) dim[i] = header.integer_at(kDimensions + 2 * i);
  if (dim[0] < 1 || dim[0] > 7) refuse(path, "the header has " + std::to_string(dim[0]) + " dimensions");
  for (int axis = 1; axis <= dim[0]; ++axis) {
    // The library takes 1 for what is less, without a word. Beyond the axes of space, 0 is common and means 1.
    const int least = axis <= 3 ? 1 : 0;
    if (dim[axis] < least)
      refuse(path, "its size on axis " + std::to_string(axis) + " is " + std::to_string(dim[axis]) +
                       "; it must be at least " + std::to_string(least));
    if (axis >= 6 && dim[axis] > 1)
      refuse(path, "it has " + std::to_string(dim[axis]) + " values on axis " + std::to_string(axis) +
                       "; use a 2-D or 3-D image");
  }

  // dim[5] is the number of components; dim[3] is 1 in a 2-D field, where its two components tell it from a slice.
  if (dim[0] >= 5) result.components = std::max(dim[5], 1);
  const int intent = header.integer_at(kIntentCode);
  // ITK takes what is no vector for one more axis, or for matrices.
  if (result.components > 1 && intent != NIFTI_INTENT_VECTOR)
    refuse(path, "it has " + std::to_string(result.components) + " values on axis 5 where its intent code is " +
                     std::to_string(intent) + "; use a 2-D or 3-D image, or give a vector image the intent code 1007");
  result.datatype = header.integer_at(kDatatype);
  // ITK takes each component to be one number, and writes past the end of its memory when it is not.
  const bool is_compound = intent == NIFTI_INTENT_VECTOR || intent == NIFTI_INTENT_SYMMATRIX;
  if (is_compound && !is_real(result.datatype))
    refuse(path, "its data type " + std::to_string(result.datatype) +
                     " is not one of real numbers, as its intent code " + std::to_string(intent) +
                     " needs; save its components as float");

  const int spatial = dim[0] < 4 ? dim[0] : 4;
  result.dimension = spatial;
  if (spatial == 4 && dim[4] <= 1) result.dimension = dim[0] >= 5 && dim[3] == 1 && result.components == 2 ? 2 : 3;
}

/// By the standard, a slope of 0 says that voxels are not scaled, whatever the intercept is, and colours never are.
void read_scaling(const std::filesystem::path& path, const HeaderBytes& header, NiftiHeader& result) {
  const float slope = header.number_at(kSlope), intercept = header.number_at(kIntercept);
  // Some programs write that there is no slope as NaN.
  if (slope == 0 || std::isnan(slope) || !is_real(result.datatype)) return;
  if (!std::isfinite(slope) || !std::isfinite(intercept))
    refuse(path, "its scl_slope is " + std::to_string(slope) + " and its scl_inter " + std::to_string(intercept) +
                     "; both must be finite numbers");
  result.slope = slope;
  result.intercept = intercept;
}

}  // namespace

NiftiHeader read_nifti_header(const std::filesystem::path& path) {
  auto refuse = [&path](const std::string& reason) -> void {
    throw FileError("cannot read " + path.filename().string() + ": " + reason);
  };
  HeaderBytes header;
  const std::unique_ptr<gzFile_s, decltype(&gzclose)> file(gzopen(path.c_str(), "rb"), &gzclose);
  if (!file) refuse("it cannot be opened");
  const auto is_read = [&file](void* to, std::size_t size) {
    return gzread(file.get(), to, static_cast<unsigned>(size)) == static_cast<int>(size);
  };
  if (!is_read(header.data(), HeaderBytes::size)) refuse("the NIfTI header is not complete");

  const std::uint32_t header_size = header.word_at(0);
  const bool is_swapped = header_size == 0x5c010000;
  if (header_size == 540 || header_size == 0x1c020000) refuse("it is a NIfTI-2 file; save it as NIfTI-1");
  if ((header_size != 348 && !is_swapped) || !header.has_at(kMagic, std::string_view("n+1\0", 4))) {
    if (header.has_at(kMagic, std::string_view("ni1\0", 4)))
      refuse("its voxels are in another file; save header and voxels in one .nii file");
    refuse("it is not a NIfTI-1 file");
  }
  if (is_swapped) header.swap_from_now_on();

  NiftiHeader result;
  read_axes(path, header, result);
  read_scaling(path, header, result);

  const auto check_places = [&](const char* what, std::size_t offset, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i)
      if (!(std::abs(header.number_at(offset + 4 * i)) <= kFarthest))
        refuse(std::string("its ") + what + " has a number that is no place in mm");
  };
  if (header.short_at(kQformCode) != 0) check_places("qform", kQuaternion, kQuaternionNumbers);
  if (header.short_at(kSformCode) != 0) check_places("sform", kSform, kSformNumbers);

  const float data_offset = header.number_at(kDataOffset);
  if (!(data_offset >= 0 && data_offset <= static_cast<float>(kLongestNifti)))
    refuse("its voxels begin at byte " + std::to_string(data_offset) + "; that must be in the first 64 MiB");

  // The library reads from byte 348 when a header gives less.
  result.data_offset = std::max(static_cast<std::size_t>(data_offset), kExtender);
  std::array<unsigned char, 4> extender{};
  if (result.data_offset > kFirstExtension && is_read(extender.data(), extender.size()) && extender[0] != 0) {
    for (std::size_t left = result.data_offset - kFirstExtension; left > 0;) {
      constexpr std::size_t head = 8, padding = 16;
      std::uint32_t size = 0, kind = 0;
      // What is smaller than an extension is padding.
      if (left < padding) break;
      if (!is_read(&size, sizeof size) || !is_read(&kind, sizeof kind)) refuse("its extensions are cut off");
      if (is_swapped) size = __builtin_bswap32(size);
      if (size < head || size > left) refuse("its extensions are damaged");
      if (gzseek(file.get(), static_cast<z_off_t>(size - head), SEEK_CUR) < 0) refuse("its extensions are cut off");
      left -= size;
    }
  }
  // The library takes 1 mm for what is no number, without a word.
  for (std::size_t axis = 1; axis <= static_cast<std::size_t>(result.dimension); ++axis) {
    const float spacing = header.number_at(kSpacing + 4 * axis);
    if (!(std::abs(spacing) <= kFarthest))
      refuse("its spacing on axis " + std::to_string(axis) + " is " + std::to_string(spacing) +
             "; it must be a length in mm");
  }
  return result;
}

NiftiPlacement read_nifti_placement(const std::filesystem::path& path) {
  const std::unique_ptr<nifti_image, decltype(&nifti_image_free)> image(nifti_image_read(path.c_str(), 0),
                                                                        &nifti_image_free);
  if (!image) throw FileError("cannot read " + path.filename().string() + ": the NIfTI header is damaged");
  NiftiPlacement placement;
  placement.spacing = {image->dx, image->dy, image->dz};
  for (int axis = 0; axis < 3; ++axis) placement.direction[axis][axis] = 1;
  const bool use_sform = use_nifti_sform(*image);
  if (!use_sform && image->qform_code == NIFTI_XFORM_UNKNOWN) return placement;

  const mat44& matrix = use_sform ? image->sto_xyz : image->qto_xyz;
  for (int row = 0; row < 3; ++row) {
    const double to_lps = row < 2 ? -1 : 1;
    placement.origin[row] = to_lps * matrix.m[row][3];
    for (int axis = 0; axis < 3; ++axis) {
      const double length = std::hypot(matrix.m[0][axis], matrix.m[1][axis], matrix.m[2][axis]);
      placement.direction[axis][row] = to_lps * matrix.m[row][axis] / length;
      placement.spacing[axis] = length;
    }
  }
  return placement;
}

}  // namespace saltus
