#include "tests/benchmark/slip_table.h"

#include <ostream>

#include "tests/benchmark/measure.h"

namespace saltus::benchmark {

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
    const Pair<2> pair = pair_of<2>(phantom);
    for (Model model : {Model::Gaussian, Model::Wendland, Model::Wendland1, Model::Sliding}) {
      RegistrationOptions options = default_options(model, SimilarityType::Ssd, Preset::Balanced);
      options.threads = 1;
      if (is_quick) options.optimisation.max_iterations = 10;
      rows.push_back(measure<2>(scene + ", " + to_string(model), pair, options));
      log << rows.back().name << ": " << rows.back().outcome << std::endl;
    }
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
