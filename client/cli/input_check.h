#pragma once

#include "client/cli/job_options.h"
#include "core/grid/image_grid.h"

#include <optional>
#include <string>
#include <vector>

namespace saltus::cli {

/// Inputs that can be used but are most likely not what was meant. Each function returns "" or one sentence that says
/// what is odd and what to do about it.

/// Voxels ten times as large, on average over the axes, as those of the other image.
template <int Dim>
std::string spacing_suspicion(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving);

/// Less than a twentieth of the fixed image lies where the moving image is, both as their headers place them.
template <int Dim>
std::string overlap_suspicion(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving);

/// An image as landmarks see it.
template <int Dim>
struct PointsPlace {
  std::string option;                        ///< that the points came by: "--fixed-points"
  std::string image;                         ///< what they should lie in: "fixed image"
  ImageGrid<Dim> grid;                       ///< of that image
  std::optional<ImageGrid<Dim>> other = {};  ///< where they would lie if they were taken the wrong way round
  std::string other_way = {};                ///< what to do then
  PointsFormat format = {};                  ///< that they were read as
};

/// More than half of the points, world mm (LPS), lie outside of their image. Tries whether they would lie in it in
/// other axes or the other unit than they were read in, or in the other image, and names the option for it.
template <int Dim>
std::string points_suspicion(const std::vector<Vector<Dim>>& points, const PointsPlace<Dim>& place);

/// All of these for a job, from headers and landmarks alone. Throws InvalidInput with the first that `options.allowed`
/// does not name. Files that cannot be read are left to the worker.
void check_inputs(const JobOptions& options);

/// Throws InvalidInput where an image of the job lies in `out` under the name of a result, see result_files.h.
void refuse_inputs_among_results(const JobOptions& options, const std::filesystem::path& out);

}  // namespace saltus::cli
