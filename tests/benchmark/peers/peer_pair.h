#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/phantom/phantom_options.h"
#include "core/registration/options.h"
#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// Landmarks of a pair that are counted apart, files as read_points reads them.
struct PeerLandmarks {
  std::filesystem::path fixed, moving;
};

/// A pair of images as files, what is known about it, and what is told to every method alike.
struct PeerPair {
  std::string scene;  ///< pairs of one scene are averaged: "liver MRI", "slip"
  std::string name;   ///< "liver a1"
  int dimension = 2;
  std::filesystem::path fixed, moving;
  SimilarityType similarity = SimilarityType::Ssd;  ///< Ssd: the same intensities; Lncc: not quite
  double grid_mm = 4;                               ///< spacing of the peers' finest control points

  std::filesystem::path truth, valid, near;      ///< a phantom's field, and masks where errors count; else empty
  std::optional<PeerLandmarks> inside, outside;  ///< of a pair without a true field
};

/// Writes a phantom's images, field and masks into `folder`.
PeerPair phantom_pair(const std::string& name, const PhantomOptions& options, SimilarityType similarity, double grid_mm,
                      const std::filesystem::path& folder);

/// The scenes that this project makes: rectangle and wheel (the paper's), slip, smooth, thorax. `size` times as many
/// voxels along each axis; the thorax and the wheel are sampled finer, the others show more of the same texture.
std::vector<PeerPair> phantom_pairs(int size, const std::filesystem::path& folder);

/// The pairs of the shared images: liver MRI of two subjects. Throws std::runtime_error that says how to name the
/// folder when one is missing.
std::vector<PeerPair> shared_pairs(const std::filesystem::path& data);

/// Errors of a displacement field (a file on the fixed grid), with the same code for every method: error_mm (mean),
/// near_mm or outside_mm, before_mm, before_outside_mm, worst_mm, folds_percent, drag. And, with the method's own
/// warped image, read_back_percent: the mean difference from what we make of its field, as a share of the intensities'
/// range: a field that was read with another meaning than its method's is far off.
void score(const PeerPair& pair, const std::filesystem::path& field, const std::filesystem::path& warped, Row& row);

}  // namespace saltus::benchmark
