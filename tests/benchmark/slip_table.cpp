#include "tests/benchmark/slip_table.h"

#include <cmath>
#include <ostream>

#include "tests/benchmark/measure.h"

namespace saltus::benchmark {
namespace {

/// The scene's own normals within 6 mm of its interface: model directional is told where and how it slides.
VectorVolume<2> normals(const Scene<2>& scene, const ImageGrid<2>& grid) {
  VectorVolume<2> field(grid);
  for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) {
    const auto nx = static_cast<std::size_t>(grid.size[0]);
    const Vector<2> x = grid.to_world({static_cast<double>(voxel % nx), static_cast<double>(voxel / nx)});
    if (!(std::abs(scene.interface_distance(x)) < 6)) continue;
    Vector<2> n;
    for (int c = 0; c < 2; ++c) {
      Vector<2> step = Vector<2>::Zero();
      step[c] = 0.01;
      n[c] = scene.interface_distance(x + step) - scene.interface_distance(x - step);
    }
    n.normalize();
    for (int c = 0; c < 2; ++c) field.component(c)[voxel] = static_cast<float>(n[c]);
  }
  return field;
}

/// The ideal: the true sides given, each registered by itself with smooth motion, as after a motion segmentation
/// without an error. Sides and their masks are the same in both images, since these scenes slide along themselves.
Row ideal_row(const std::string& name, const Pair<2>& pair, RegistrationOptions options) {
  Row row;
  row.name = name;
  VectorVolume<2> together(pair.input.fixed.grid);
  double seconds = 0, iterations = 0;
  for (const Volume<2>* side : {&pair.truth.masks.inside, &pair.truth.masks.outside}) {
    RegistrationInput<2> input = pair.input;
    input.fixed_mask = *side;
    input.moving_mask = *side;
    const RegistrationResult<2> found = register_images<2>(input, options);
    seconds += found.summary.cpu_seconds;
    iterations += static_cast<double>(found.summary.history.size());
    for (std::size_t voxel = 0; voxel < side->samples.size(); ++voxel)
      for (int c = 0; c < 2; ++c)
        if (side->samples[voxel] > 0) together.component(c)[voxel] = found.displacement.component(c)[voxel];
  }
  add_truth(pair, together, row);
  row.add("iterations", iterations);
  row.add("cpu_seconds", seconds);
  row.outcome = "two registrations";
  return row;
}

}  // namespace

std::vector<Row> slip_rows(bool is_quick, std::ostream& log) {
  std::vector<std::pair<std::string, PhantomOptions>> scenes;
  for (int degrees : {0, 15, 30, 45}) {
    PhantomOptions options = default_phantom_options(PhantomKind::Slip);
    options.angle_deg = degrees;
    scenes.emplace_back("line " + std::to_string(degrees), options);
  }
  PhantomOptions circle = default_phantom_options(PhantomKind::Slip);
  circle.interface = InterfaceShape::Circle;
  circle.radius_mm = 36;
  scenes.emplace_back("circle 36", circle);
  if (is_quick) scenes = {scenes.front(), scenes.back()};

  std::vector<Row> rows;
  for (const auto& [scene, phantom] : scenes) {
    Pair<2> pair = pair_of<2>(phantom);
    for (Model model :
         {Model::Gaussian, Model::Wendland, Model::Wendland1, Model::Directional, Model::Sliding, Model::Auto}) {
      pair.input.direction.reset();
      if (model == Model::Directional) pair.input.direction = normals(*pair.scene, pair.input.fixed.grid);
      RegistrationOptions options = default_options(model, SimilarityType::Ssd, Preset::Balanced);
      options.threads = 1;
      if (is_quick) options.optimisation.max_iterations = 10;
      rows.push_back(measure<2>(scene + ", " + to_string(model), pair, options));
      log << rows.back().name << ": " << rows.back().outcome << std::endl;
    }
    pair.input.direction.reset();
    RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
    options.threads = 1;
    if (is_quick) options.optimisation.max_iterations = 10;
    options.momenta.orientations = 8;
    rows.push_back(measure<2>(scene + ", sliding, 8 orientations", pair, options));
    log << rows.back().name << ": " << rows.back().outcome << std::endl;
    options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced);
    options.threads = 1;
    if (is_quick) options.optimisation.max_iterations = 10;
    rows.push_back(ideal_row(scene + ", the true sides given", pair, options));
    log << rows.back().name << ": " << rows.back().outcome << std::endl;
  }
  return rows;
}

const std::vector<Column>& slip_columns() {
  static const std::vector<Column> columns = {{"before_mm", "before, px"},
                                              {"error_mm", "error, px"},
                                              {"near_mm", "within 3 px"},
                                              {"transition_mm", "10-90 % width, px"},
                                              {"jump_mm", "jump, px"},
                                              {"folds_percent", "folds off it, %", 3},
                                              {"active_percent", "order 1 active, %", 1},
                                              {"iterations", "iterations", 0},
                                              {"cpu_seconds", "CPU s", 1}};
  return columns;
}

}  // namespace saltus::benchmark
