#include "core/image_io/image_format.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <utility>

#include "core/support/errors.h"

namespace saltus {

ImageFormat format_from_suffix(const std::filesystem::path& path) {
  static const std::array<std::pair<std::string, ImageFormat>, 5> formats{{
      {".mha", ImageFormat::MetaImage},
      {".nii", ImageFormat::Nifti},
      {".nii.gz", ImageFormat::CompressedNifti},
      {".nrrd", ImageFormat::Nrrd},
      {".png", ImageFormat::Png},
  }};
  std::string name = path.filename().string();
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
  for (const auto& [suffix, format] : formats) {
    if (name.ends_with(suffix)) return format;
  }
  throw InvalidInput("image format of '" + path.filename().string() +
                     "' is not known; use a name that ends in .mha, .nii, .nii.gz, .nrrd or .png");
}

}  // namespace saltus
