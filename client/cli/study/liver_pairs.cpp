#include "client/cli/study/liver_pairs.h"

#include "client/cli/study/pair_figures.h"
#include "core/evaluation/field_error.h"
#include "core/image_io/points_io.h"

namespace saltus::cli {

namespace fs = std::filesystem;

std::vector<LiverPair> find_liver_pairs(const fs::path& data) {
  std::vector<LiverPair> pairs;
  if (data.empty() || !fs::is_directory(data / "liver_mri")) return pairs;
  for (const char* subject : {"subject_a", "subject_b"})
    for (const char* number : {"1", "2"}) {
      const fs::path folder = data / "liver_mri" / subject;
      const std::string moving = std::string("moving_") + number;
      const auto points = [&](const std::string& name) { return read_points<3>(folder / (name + ".csv")); };
      pairs.push_back({std::string(subject) + "_" + number, folder / "fixed.mha", folder / (moving + ".mha"),
                       points("fixed_liver"), points(moving + "_liver"), points("fixed_outside"),
                       points(moving + "_outside")});
    }
  return pairs;
}

drawing::SlicePlane<3> liver_plane(const VectorVolume<3>& displacement) {
  drawing::SlicePlane<3> plane = main_plane(displacement);
  plane.down_is_reversed = !plane.down_is_reversed;
  return plane;
}

LiverErrors liver_errors(const LiverPair& pair, const VectorVolume<3>& displacement) {
  return {summarise(landmark_errors(displacement, pair.fixed_liver, pair.moving_liver)),
          summarise(landmark_errors(displacement, pair.fixed_outside, pair.moving_outside))};
}

LiverErrors liver_errors_before(const LiverPair& pair) {
  return {summarise(landmark_distances(pair.fixed_liver, pair.moving_liver)),
          summarise(landmark_distances(pair.fixed_outside, pair.moving_outside))};
}

}  // namespace saltus::cli
