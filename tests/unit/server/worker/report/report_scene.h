#pragma once

#include "server/worker/report/analysis.h"
#include "server/worker/report/report.h"

#include <cmath>

namespace saltus::report {

template <int Dim>
std::string json_of(const ReportInput<Dim>& input) {
  return report_json(input, analyse(input));
}
template <int Dim>
std::string html_of(const ReportInput<Dim>& input) {
  return report_html(input, analyse(input));
}

/// A finished registration whose numbers are known in closed form: the half with x < middle shifts by `shift_mm` along
/// the last axis, the other half against it. Owns what ReportInput points to, so it is not copied.
template <int Dim>
struct ReportScene {
  RegistrationInput<Dim> images;
  RegistrationResult<Dim> result;
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Fast);
  ReportInput<Dim> report;

  static Index<Dim> small() {
    Index<Dim> size{};
    for (int axis = 0; axis < Dim; ++axis) size[axis] = 12 + 4 * axis;
    return size;
  }

  explicit ReportScene(double shift_mm, const Index<Dim>& size = small()) {
    ImageGrid<Dim> grid;
    grid.size = size;
    grid.spacing[Dim - 1] = 2;
    grid.origin[0] = -5;
    result.options = options;
    images.fixed = images.moving = Volume<Dim>(grid);
    result.displacement = result.inverse_displacement = VectorVolume<Dim>(grid);
    result.warped = Volume<Dim>(grid);
    result.jacobian = Volume<Dim>(grid, 1.0f);
    for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) {
      const int x = static_cast<int>(voxel) % grid.size[0];
      const auto shift = static_cast<float>(x < grid.size[0] / 2 ? shift_mm : -shift_mm);
      result.displacement.component(Dim - 1)[voxel] = shift;
      result.inverse_displacement.component(Dim - 1)[voxel] = -shift;
      images.fixed.samples[voxel] = result.warped.samples[voxel] =
          static_cast<float>(std::sin(0.1 * static_cast<double>(voxel)));
      images.moving.samples[voxel] = static_cast<float>(std::cos(0.1 * static_cast<double>(voxel)));
    }
    std::size_t middle = 0, stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      middle += stride * static_cast<std::size_t>(grid.size[axis] / 2);
      stride *= static_cast<std::size_t>(grid.size[axis]);
    }
    for (std::size_t voxel = 0; shift_mm != 0 && voxel < grid.voxels();
         voxel += static_cast<std::size_t>(grid.size[0])) {
      Vector<Dim> at;
      at[0] = grid.size[0] / 2 - 0.5;
      std::size_t rest = voxel / static_cast<std::size_t>(grid.size[0]);
      for (int axis = 1; axis < Dim; ++axis) {
        at[axis] = static_cast<double>(rest % static_cast<std::size_t>(grid.size[axis]));
        rest /= static_cast<std::size_t>(grid.size[axis]);
      }
      SlipPoint<Dim> point;
      point.position = grid.to_world(at);
      point.normal = Vector<Dim>::Unit(0);
      point.area = grid.voxel_volume() / grid.spacing[0];
      point.jump = -2 * shift_mm * Vector<Dim>::Unit(Dim - 1);
      point.gap_mm = -0.125;
      result.slip.points.push_back(point);
    }
    result.slip.least_jump_mm = 0.25;
    result.jacobian.samples[middle] = -0.5f;
    result.jacobian.samples[middle + 1] = 2.0f;

    MomentumField<Dim> smooth{.kernel = "gaussian", .width_mm = 8, .axis = -1, .vectors = VectorVolume<Dim>(grid)};
    smooth.vectors.component(0)[3] = 1.5f;
    MomentumField<Dim> jump{.kernel = "wendland", .width_mm = 4, .axis = 0, .vectors = VectorVolume<Dim>(grid)};
    result.momenta = {smooth, jump};

    RegistrationSummary& summary = result.summary;
    summary.levels = {{.level = 1,
                       .grid = "6x8",
                       .spacing_mm = 2,
                       .iterations = 2,
                       .evaluations = 3,
                       .rounds = 2,
                       .optimality = 0.125,
                       .smoothing_voxels = 0.75,
                       .similarity_weight = 0.5,
                       .energy_before = 9,
                       .energy_after = 4,
                       .termination = Termination::Converged,
                       .seconds = 0.5,
                       .cpu_seconds = 0.75}};
    summary.history = {
        {.level = 1, .iteration = 1, .energy = 6, .similarity = 5, .regularisation = 1, .optimality = 0.5},
        {.level = 1,
         .round = 2,
         .iteration = 2,
         .energy = 4,
         .similarity = 2.5,
         .regularisation = 1.5,
         .optimality = 0.1}};
    summary.termination = Termination::Converged;
    summary.noise = 0.0625;
    summary.similarity_before = 9;
    summary.similarity_after = 2.5;
    summary.seconds = 1.25;
    summary.cpu_seconds = 2.5;
    summary.hamiltonian_drift = 0.001;
    summary.inverse_consistency_mm = 0.02;
    summary.active_first_order_share = 0.25;

    report = {.input = &images,
              .result = &result,
              .options = &options,
              .fixed_points = {},
              .moving_points = {},
              .title = "Scene",
              .peak_memory_bytes = 1 << 20,
              .program = "saltus 9.8",
              .digests = {{"fixed", "sha256:0123"}},
              .job_options = {{"affine", "rigid"}},
              .stage_seconds = {{"fetching", 0.125}}};
  }
  ReportScene(const ReportScene&) = delete;

  /// Landmark at a voxel of the fixed image; its partner lies where u leads, plus `error_mm` along x.
  void add_landmark(const Vector<Dim>& index, double error_mm) {
    const ImageGrid<Dim>& grid = images.fixed.grid;
    std::size_t voxel = 0;
    for (int axis = Dim - 1; axis >= 0; --axis)
      voxel = voxel * static_cast<std::size_t>(grid.size[axis]) + static_cast<std::size_t>(index[axis]);
    Vector<Dim> moved = grid.to_world(index);
    report.fixed_points.push_back(moved);
    for (int c = 0; c < Dim; ++c) moved[c] += result.displacement.component(c)[voxel];
    moved[0] += error_mm;
    report.moving_points.push_back(moved);
  }
};

}  // namespace saltus::report
