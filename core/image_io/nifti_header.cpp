#include "core/image_io/nifti_header.h"

#include <nifti1_io.h>
#include <zlib.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>

#include "core/support/errors.h"

namespace saltus {
namespace {

bool use_nifti_sform(const nifti_image& image) {
  return image.sform_code != NIFTI_XFORM_UNKNOWN &&
         (image.sform_code == NIFTI_XFORM_SCANNER_ANAT || image.qform_code == NIFTI_XFORM_UNKNOWN);
}

}  // namespace

NiftiHeader read_nifti_header(const std::filesystem::path& path) {
  auto refuse = [&path](const std::string& reason) -> void {
    throw FileError("cannot read " + path.filename().string() + ": " + reason);
  };
  std::array<char, 348> header{};
  const std::unique_ptr<gzFile_s, decltype(&gzclose)> file(gzopen(path.c_str(), "rb"), &gzclose);
  if (!file) refuse("it cannot be opened");
  if (gzread(file.get(), header.data(), header.size()) != static_cast<int>(header.size()))
    refuse("the NIfTI header is not complete");

  std::int32_t header_size = 0;
  std::memcpy(&header_size, header.data(), sizeof header_size);
  const bool is_swapped = header_size == 0x5c010000;
  if (header_size == 540 || header_size == 0x1c020000) refuse("it is a NIfTI-2 file; save it as NIfTI-1");
  if ((header_size != 348 && !is_swapped) || std::memcmp(header.data() + 344, "n+1", 4) != 0) {
    if (std::memcmp(header.data() + 344, "ni1", 4) == 0)
      refuse("its voxels are in another file; save header and voxels in one .nii file");
    refuse("it is not a NIfTI-1 file");
  }

  std::array<std::uint16_t, 8> dim{};
  std::memcpy(dim.data(), header.data() + 40, sizeof dim);
  if (is_swapped) {
    for (std::uint16_t& d : dim) d = static_cast<std::uint16_t>(d << 8 | d >> 8);
  }
  if (dim[0] < 1 || dim[0] > 7) refuse("the header has " + std::to_string(dim[0]) + " dimensions");

  std::uint32_t offset_bits = 0;
  std::memcpy(&offset_bits, header.data() + 108, sizeof offset_bits);
  if (is_swapped) offset_bits = __builtin_bswap32(offset_bits);
  const float data_offset = std::bit_cast<float>(offset_bits);

  NiftiHeader result;
  // The library reads from byte 348 when a header gives less.
  result.data_offset = data_offset > 348 && data_offset < 1e9 ? static_cast<std::size_t>(data_offset) : 348;
  // dim[5] is the number of components; dim[3] is 1 in a 2-D field, where its two components tell it from a slice.
  if (dim[0] >= 5) result.components = dim[5];
  for (int axis = 6; axis <= dim[0]; ++axis) {
    if (dim[axis] > 1) refuse("the header has more than five dimensions");
  }
  const int spatial = dim[0] < 4 ? dim[0] : 4;
  result.dimension = spatial;
  if (spatial == 4 && dim[4] <= 1) result.dimension = dim[0] >= 5 && dim[3] == 1 && result.components == 2 ? 2 : 3;

  // The library takes 1 mm for what is no number, without a word.
  for (int axis = 1; axis <= result.dimension; ++axis) {
    std::uint32_t spacing_bits = 0;
    std::memcpy(&spacing_bits, header.data() + 76 + 4 * axis, sizeof spacing_bits);
    if (is_swapped) spacing_bits = __builtin_bswap32(spacing_bits);
    const float spacing = std::bit_cast<float>(spacing_bits);
    if (!std::isfinite(spacing))
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
