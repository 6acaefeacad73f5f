#pragma once

#include <filesystem>
#include <string>

namespace saltus::cli {

/// What a registration job calls the format that the end of an image file's name says: mha, nii, nii.gz, nrrd or png.
/// Upper and lower case are the same. Throws InvalidInput that names `option` and lists the suffixes there are.
std::string image_format(const std::string& option, const std::filesystem::path& file);

/// The same for landmark files, which are .csv.
std::string points_format(const std::string& option, const std::filesystem::path& file);

}  // namespace saltus::cli
