#pragma once

#include <exception>
#include <filesystem>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace saltus::worker {

enum class AffineStart { None, Rigid, Affine };

/// A registration whose inputs are files. Names are those of core/registration/options.h, "" for the default.
struct RegistrationTask {
  std::filesystem::path fixed, moving;
  std::optional<std::filesystem::path> fixed_mask, moving_mask;
  std::optional<std::filesystem::path> fixed_points, moving_points;  ///< both or none
  std::string model, similarity, preset;
  std::map<std::string, std::string> settings;
  AffineStart affine = AffineStart::None;
  std::optional<std::pair<double, double>> intensity_window;
  struct Box {
    std::vector<int> begin, end;
  };
  std::optional<Box> crop;    ///< voxels of the fixed image, [begin, end); everything is delivered on the cropped grid
  std::string output_format;  ///< mha, nii.gz or nrrd; "" = nii.gz
  int threads = 1;
  std::map<std::string, std::string> digests;  ///< of the files, for the report: "fixed" -> "sha256:..."; may be empty
};

/// The task cannot be done, and would fail again in the same way.
class TaskFailure : public std::runtime_error {
 public:
  TaskFailure(std::string reason, const std::string& message)
      : std::runtime_error(message), reason_(std::move(reason)) {}
  /// INPUT_UNREADABLE, GEOMETRY_MISMATCH, NON_FINITE_INPUT, INVALID_OPTIONS, INVALID_INPUT, DIVERGED, MEMORY_LIMIT,
  /// OUTPUT_UNWRITABLE or INTERNAL.
  const std::string& reason() const { return reason_; }

 private:
  std::string reason_;
};

/// The observer asked for the end.
class TaskStopped : public std::exception {
 public:
  const char* what() const noexcept override { return "stopped on request"; }
};

}  // namespace saltus::worker
