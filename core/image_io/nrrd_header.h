#pragma once

#include <cstdint>
#include <filesystem>

namespace saltus {

struct NrrdHeader {
  bool is_raw = false;  ///< the voxels are neither compressed nor text
  bool is_gzip = false;
  std::uint64_t data_offset = 0;  ///< byte at which the voxels begin
};

/// Reads the text header of a .nrrd. Throws FileError when there is none, or when it says that the voxels are in
/// another file or do not follow it.
NrrdHeader read_nrrd_header(const std::filesystem::path& path);

}  // namespace saltus
