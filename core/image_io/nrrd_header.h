#pragma once

#include <filesystem>

namespace saltus {

struct NrrdHeader {
  bool is_raw = false;  ///< the voxels are neither compressed nor text
};

/// Reads the text header of a .nrrd. Throws FileError when there is none, or when it says that the voxels are in
/// another file.
NrrdHeader read_nrrd_header(const std::filesystem::path& path);

}  // namespace saltus
