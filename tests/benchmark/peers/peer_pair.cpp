#include "tests/benchmark/peers/peer_pair.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/evaluation/field_error.h"
#include "core/evaluation/field_sampling.h"
#include "core/evaluation/jacobian.h"
#include "core/evaluation/statistics.h"
#include "core/evaluation/warp_image.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/phantom/make_phantom.h"

namespace saltus::benchmark {
namespace {

template <int Dim>
void write_phantom(const PhantomOptions& options, const PeerPair& pair) {
  const Phantom<Dim> phantom = make_phantom<Dim>(options);
  write_volume<Dim>(pair.fixed, phantom.fixed);
  write_volume<Dim>(pair.moving, phantom.moving);
  write_vector_volume<Dim>(pair.truth, phantom.displacement);
  write_labels<Dim>(pair.valid, phantom.masks.valid);
  Volume<Dim> near = phantom.masks.near;
  for (std::size_t voxel = 0; voxel < near.samples.size(); ++voxel)
    near.samples[voxel] *= phantom.masks.valid.samples[voxel];
  write_labels<Dim>(pair.near, near);
}

template <int Dim>
void score_in(const PeerPair& pair, const std::filesystem::path& field_file, const std::filesystem::path& warped_file,
              Row& row) {
  const VectorVolume<Dim> field = read_vector_volume<Dim>(field_file);
  if (!std::all_of(field.samples.begin(), field.samples.end(), [](float value) { return std::isfinite(value); })) {
    row.complaints.push_back("the field is not finite");
    return;
  }
  if (!pair.truth.empty()) {
    const VectorVolume<Dim> truth = read_vector_volume<Dim>(pair.truth), still(truth.grid);
    const auto valid = read_volume<Dim>(pair.valid), near = read_volume<Dim>(pair.near);
    const Statistics errors = summarise(endpoint_errors<Dim>(field, truth, valid));
    row.add("before_mm", summarise(endpoint_errors<Dim>(still, truth, valid)).mean);
    row.add("error_mm", errors.mean);
    row.add("worst_mm", errors.max);
    if (std::any_of(near.samples.begin(), near.samples.end(), [](float value) { return value > 0; }))
      row.add("near_mm", summarise(endpoint_errors<Dim>(field, truth, near)).mean);
  }
  double liver_motion = 0;
  for (const auto& [where, prefix] : {std::pair{&pair.inside, ""}, {&pair.outside, "outside_"}}) {
    if (!*where) continue;
    const std::vector<Vector<Dim>> from = read_points<Dim>((*where)->fixed), to = read_points<Dim>((*where)->moving);
    const std::vector<double> before = landmark_distances<Dim>(from, to);
    const Statistics after = summarise(landmark_errors<Dim>(field, from, to));
    const std::string name = prefix;
    row.add(name.empty() ? "before_mm" : "before_outside_mm", summarise(before).mean);
    row.add(name.empty() ? "error_mm" : "outside_mm", after.mean);
    row.add(name.empty() ? "worst_mm" : "worst_outside_mm", after.max);
    if (name.empty()) {
      liver_motion = summarise(before).mean;
      continue;
    }
    // How much of the inner motion is given to landmarks that hardly move.
    std::vector<double> dragged;
    for (std::size_t k = 0; k < from.size(); ++k)
      if (before[k] < 3) dragged.push_back(displacement_at<Dim>(field, from[k]).norm() / liver_motion);
    if (dragged.size() > 2 && liver_motion > 10) row.add("drag", summarise(dragged).mean);
  }
  row.add("folds_percent", 100 * jacobian_statistics<Dim>(jacobian_determinant<Dim>(field)).share_not_positive);

  const Volume<Dim> ours = warp_image<Dim>(read_volume<Dim>(pair.moving), field),
                    theirs = read_volume<Dim>(warped_file);
  if (ours.samples.size() != theirs.samples.size())
    throw std::runtime_error(warped_file.string() + " has another grid");
  std::vector<double> range(ours.samples.begin(), ours.samples.end()), difference;
  std::sort(range.begin(), range.end());
  const double width = quantile_of_sorted(range, 0.99) - quantile_of_sorted(range, 0.01);
  // Beyond the moving image every program has its own idea; there is more of it the more moves.
  const ImageGrid<Dim> moving = read_grid<Dim>(pair.moving);
  for (std::size_t voxel = 0; voxel < ours.samples.size(); ++voxel) {
    std::size_t rest = voxel;
    Vector<Dim> at, moved;
    for (int axis = 0; axis < Dim; ++axis) {
      at[axis] = static_cast<double>(rest % static_cast<std::size_t>(field.grid.size[axis]));
      rest /= static_cast<std::size_t>(field.grid.size[axis]);
    }
    moved = field.grid.to_world(at);
    for (int c = 0; c < Dim; ++c) moved[c] += field.component(c)[voxel];
    const Vector<Dim> index = moving.to_index(moved);
    bool is_inside = true;
    for (int axis = 0; axis < Dim; ++axis)
      is_inside = is_inside && index[axis] >= 0 && index[axis] <= moving.size[axis] - 1;
    if (is_inside) difference.push_back(std::abs(ours.samples[voxel] - theirs.samples[voxel]) / width);
  }
  const double read_back = 100 * summarise(difference).mean;
  row.add("read_back_percent", read_back);
  if (!(read_back < 1)) row.complaints.push_back("its warped image is not what its field says");
}

}  // namespace

PeerPair phantom_pair(const std::string& name, const PhantomOptions& options, SimilarityType similarity, double grid_mm,
                      const std::filesystem::path& folder) {
  PeerPair pair{.scene = name,
                .name = name,
                .dimension = options.dimension,
                .fixed = folder / "fixed.mha",
                .moving = folder / "moving.mha",
                .similarity = similarity,
                .grid_mm = grid_mm,
                .truth = folder / "truth.mha",
                .valid = folder / "valid.mha",
                .near = folder / "near.mha",
                .inside = {},
                .outside = {}};
  std::filesystem::create_directories(folder);
  if (options.dimension == 2)
    write_phantom<2>(options, pair);
  else
    write_phantom<3>(options, pair);
  return pair;
}

std::vector<PeerPair> phantom_pairs(int size, const std::filesystem::path& folder) {
  std::vector<PeerPair> pairs;
  struct Choice {
    PhantomKind kind;
    SimilarityType similarity;
    double grid_mm;
  };
  for (const Choice& choice :
       {Choice{PhantomKind::Rectangle, SimilarityType::Ssd, 4}, Choice{PhantomKind::Wheel, SimilarityType::Ssd, 4},
        Choice{PhantomKind::Slip, SimilarityType::Ssd, 6}, Choice{PhantomKind::Smooth, SimilarityType::Ssd, 8},
        Choice{PhantomKind::Thorax, SimilarityType::Lncc, 10}}) {
    PhantomOptions options = default_phantom_options(choice.kind);
    for (int axis = 0; axis < options.dimension; ++axis) {
      options.size[static_cast<std::size_t>(axis)] *= size;
      if (choice.kind == PhantomKind::Thorax || choice.kind == PhantomKind::Wheel)
        options.spacing[static_cast<std::size_t>(axis)] /= size;
    }
    if (choice.kind == PhantomKind::Slip) options.angle_deg = 30;
    std::string name = to_string(choice.kind);
    if (choice.kind == PhantomKind::Slip) name += " at 30 degrees";
    if (size != 1) name += " x" + std::to_string(size);
    std::string file = to_string(choice.kind) + "_" + std::to_string(size);
    pairs.push_back(phantom_pair(name, options, choice.similarity, choice.grid_mm, folder / file));
  }
  return pairs;
}

std::vector<PeerPair> shared_pairs(const std::filesystem::path& data) {
  std::vector<PeerPair> pairs;
  for (const char* subject : {"a", "b"})
    for (const char* number : {"1", "2"}) {
      const std::filesystem::path folder = data / "liver_mri" / (std::string("subject_") + subject);
      const std::string moving = std::string("moving_") + number;
      PeerPair pair;
      pair.scene = "liver MRI";
      pair.name = std::string("liver ") + subject + number;
      pair.dimension = 3;
      pair.fixed = folder / "fixed.mha";
      pair.moving = folder / (moving + ".mha");
      pair.similarity = SimilarityType::Lncc;
      pair.grid_mm = 10;
      pair.inside = {folder / "fixed_liver.csv", folder / (moving + "_liver.csv")};
      pair.outside = {folder / "fixed_outside.csv", folder / (moving + "_outside.csv")};
      for (const auto& file : {pair.fixed, pair.moving, pair.inside->fixed, pair.outside->moving})
        if (!std::filesystem::is_regular_file(file))
          throw std::runtime_error(file.string() +
                                   " is missing; name the folder of the shared images by --data or in "
                                   "SALTUS_SHARED_DATA, or leave its pairs out by --only");
      pairs.push_back(std::move(pair));
    }
  return pairs;
}

void score(const PeerPair& pair, const std::filesystem::path& field, const std::filesystem::path& warped, Row& row) {
  if (pair.dimension == 2)
    score_in<2>(pair, field, warped, row);
  else
    score_in<3>(pair, field, warped, row);
}

}  // namespace saltus::benchmark
