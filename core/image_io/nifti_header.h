#pragma once

#include <array>
#include <cstddef>
#include <filesystem>

namespace saltus {

/// Byte of a NIfTI-1 header at which the sizes of the axes begin, 16 bits each.
constexpr std::size_t kNiftiSizes = 42;

/// What a NIfTI-1 header says and ITK's reader does not pass on.
struct NiftiHeader {
  int dimension = 0;                ///< of space, 2 or 3 (4 or more: time or the like has more than one value)
  int components = 1;               ///< values a voxel
  int datatype = 0;                 ///< of what is stored, a DT_ code
  double slope = 1, intercept = 0;  ///< a voxel's value is slope * stored + intercept
  std::size_t data_offset = 0;      ///< byte at which the voxels begin
};

/// Where the voxels are, in LPS millimetres.
struct NiftiPlacement {
  std::array<double, 3> spacing{};
  std::array<double, 3> origin{};
  std::array<std::array<double, 3>, 3> direction{};  ///< [j] is the world direction of grid axis j
};

/// Reads the header of a .nii or .nii.gz, with the sizes of its extensions. Throws FileError unless it is a NIfTI-1
/// header of a single file, its voxels begin within 64 MiB, its extensions end before them, the numbers that place it
/// are within 1e9 mm (ITK ends the process over a place that is not finite), and its axes and type of voxels are among
/// those that ITK reads within the memory that they take: several values a voxel need the intent code of a vector.
NiftiHeader read_nifti_header(const std::filesystem::path& path);

/// All three axes of a file that has one slice, where ITK's reader gives two only. Chooses between sform and qform as
/// ITK does, see read_image.h. Throws FileError.
NiftiPlacement read_nifti_placement(const std::filesystem::path& path);

}  // namespace saltus
