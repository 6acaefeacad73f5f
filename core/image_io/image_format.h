#pragma once

#include <filesystem>

namespace saltus {

/// The image formats that are read and written: each holds header and voxels in one file.
enum class ImageFormat { MetaImage, Nifti, CompressedNifti, Nrrd, Png };

/// The format that the end of the file's name says (.mha .nii .nii.gz .nrrd .png, in any case).
/// Throws InvalidInput that lists the formats there are.
ImageFormat format_from_suffix(const std::filesystem::path& path);

}  // namespace saltus
