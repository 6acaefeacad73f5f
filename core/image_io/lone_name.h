#pragma once

#include <filesystem>

namespace saltus {

/// A name of a file under which nothing else is found: the NIfTI library takes the voxels of a.nii.gz from a.nii where
/// that lies beside it. That is the path itself, or, beside such a file, a link in a folder of its own, which goes with
/// this.
class LoneName {
 public:
  /// Throws FileError when the folder or the link cannot be made.
  explicit LoneName(const std::filesystem::path& file);
  ~LoneName();
  LoneName(const LoneName&) = delete;
  LoneName& operator=(const LoneName&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_, folder_;
};

}  // namespace saltus
