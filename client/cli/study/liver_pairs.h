#pragma once

#include "core/drawing/slice_plane.h"
#include "core/evaluation/statistics.h"
#include "core/grid/volume.h"

#include <filesystem>
#include <string>
#include <vector>

namespace saltus::cli {

/// A pair of the liver images: `liver_mri/subject_a` and `_b` below a folder of data, with `fixed.mha`, `moving_N.mha`
/// and landmarks `fixed_liver.csv`, `fixed_outside.csv`, `moving_N_liver.csv`, `moving_N_outside.csv`.
struct LiverPair {
  std::string name;  ///< "subject_a_1"
  std::filesystem::path fixed, moving;
  std::vector<Vector<3>> fixed_liver, moving_liver, fixed_outside, moving_outside;
};

/// All of them, in order; none when `data` is empty or has no liver_mri. Throws FileError when a file is missing there.
std::vector<LiverPair> find_liver_pairs(const std::filesystem::path& data);

/// The plane in which they are shown, upright: the files have the head below, which their headers do not say.
drawing::SlicePlane<3> liver_plane(const VectorVolume<3>& displacement);

/// Landmark errors in mm, inside the liver and outside, where nothing but breathing's drag should move.
struct LiverErrors {
  Statistics liver, outside;
};
LiverErrors liver_errors(const LiverPair& pair, const VectorVolume<3>& displacement);
LiverErrors liver_errors_before(const LiverPair& pair);

}  // namespace saltus::cli
