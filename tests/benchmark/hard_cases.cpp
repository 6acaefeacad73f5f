#include "tests/benchmark/hard_cases.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <ostream>

#include "core/registration/scales.h"
#include "tests/benchmark/layered_scene.h"
#include "tests/benchmark/measure.h"
#include "tests/benchmark/precision.h"
#include "tests/benchmark/trajectories.h"

namespace saltus::benchmark {
namespace {

/// Collects the cases, in order, and runs those that are wanted.
class Run {
 public:
  Run(bool is_quick, std::string only, std::ostream& log) : is_quick_(is_quick), only_(std::move(only)), log_(log) {}

  bool is_quick() const { return is_quick_; }
  /// Edge of the planar scenes, px.
  int edge() const { return is_quick_ ? 64 : 96; }

  void add(const std::string& name, const std::function<Row()>& make) {
    if (name.find(only_) == std::string::npos) return;
    rows_.push_back(make());
    log_ << name << ": " << rows_.back().outcome << std::endl;
  }

  std::vector<Row> rows() && { return std::move(rows_); }

 private:
  bool is_quick_;
  std::string only_;
  std::ostream& log_;
  std::vector<Row> rows_;
};

RegistrationOptions defaults(SimilarityType similarity = SimilarityType::Ssd) {
  RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
  options.threads = 1;
  return options;
}

PhantomOptions slip(const Run& run, double slip_mm, double degrees = 0) {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.size = {run.edge(), run.edge(), 1};
  options.slip_mm = slip_mm;
  options.angle_deg = degrees;
  return options;
}

ImageGrid<2> square(int edge) {
  ImageGrid<2> grid;
  grid.size = {edge, edge};
  return grid;
}

Pair<2> pair_without_truth(const ImageGrid<2>& grid, const std::function<float(int, int)>& fixed,
                           const std::function<float(int, int)>& moving) {
  Pair<2> pair;
  pair.input.fixed = pair.input.moving = Volume<2>(grid);
  for (int y = 0; y < grid.size[1]; ++y)
    for (int x = 0; x < grid.size[0]; ++x) {
      const std::size_t voxel = static_cast<std::size_t>(y) * grid.size[0] + x;
      pair.input.fixed.samples[voxel] = fixed(x, y);
      pair.input.moving.samples[voxel] = moving(x, y);
    }
  return pair;
}

void add_large_motion(Run& run) {
  if (run.is_quick()) return;
  run.add("large motion, 40 voxels", [] {
    PhantomOptions phantom = default_phantom_options(PhantomKind::Smooth);
    phantom.size = {272, 272, 1};
    phantom.displacement_mm = 40;
    return measure<2>("large motion, 40 voxels", pair_of<2>(phantom), defaults());
  });
  run.add("thorax, 20 mm", [] {
    RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Fast);
    options.pyramid.finest_level = 1;
    options.threads = 1;
    return measure<3>("thorax, 20 mm", pair_of<3>(default_phantom_options(PhantomKind::Thorax)), options);
  });
}

void add_slips(Run& run) {
  const std::vector<int> angles = run.is_quick() ? std::vector<int>{0, 30} : std::vector<int>{0, 10, 30, 45};
  const std::vector<int> slips = run.is_quick() ? std::vector<int>{1, 6, 20} : std::vector<int>{1, 3, 6, 12, 20};
  for (int degrees : angles)
    for (int px : slips) {
      const std::string name = "slip of " + std::to_string(px) + " px at " + std::to_string(degrees) + " degrees";
      run.add(name, [&] { return measure<2>(name, pair_of<2>(slip(run, px, degrees)), defaults()); });
    }
}

void add_interfaces(Run& run) {
  const auto layered = [&](const std::string& name, LayeredScene::Shape shape) {
    run.add(name, [&, shape] {
      const ImageGrid<2> grid = square(run.edge());
      return measure<2>(name, pair_of<2>(std::make_shared<LayeredScene>(shape, grid), grid, 0.03), defaults());
    });
  };
  const double middle = 0.5 * (run.edge() - 1), edge = run.edge();
  layered("two interfaces 4 px apart, sigma 6", strip(middle + 0.5, 2, 6));
  layered("interface that ends inside the image", ending_interface(middle, 6, 0.35 * edge, 0.7 * edge));
  layered("gap of 2 px", thin_gap(middle, 6, 2));
}

void add_discretisation(Run& run) {
  for (int steps : {1, 2}) {
    const std::string name = "time steps: " + std::to_string(steps);
    run.add(name, [&] {
      RegistrationOptions options = defaults();
      options.flow.time_steps = steps;
      return measure<2>(name, pair_of<2>(slip(run, 12)), options);
    });
  }
  for (int width : {2, 40}) {
    const std::string name = "sigma of " + std::to_string(width) + " voxels";
    run.add(name, [&] {
      RegistrationOptions options = defaults();
      options.momenta.width_voxels = width;
      return measure<2>(name, pair_of<2>(slip(run, 6)), options);
    });
  }
  run.add("one kernel, H drift, gaussian", [&] {
    RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced);
    options.momenta.scales = 1;
    options.momenta.width_voxels = 12;
    options.flow.evolution = Evolution::Exact;
    options.flow.time_steps = 3;
    options.threads = 1;
    return measure<2>("one kernel, H drift, gaussian", pair_of<2>(slip(run, 6)), options);
  });
  run.add("one kernel, H drift, wendland1", [&] {
    RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ssd, Preset::Balanced);
    options.momenta.scales = 1;
    options.momenta.width_voxels = 12;
    options.flow.evolution = Evolution::Exact;
    options.flow.time_steps = 3;
    options.threads = 1;
    return measure<2>("one kernel, H drift, wendland1", pair_of<2>(slip(run, 6)), options);
  });
}

void add_shapes(Run& run) {
  run.add("spacing 1 x 1 x 10", [&] {
    PhantomOptions phantom = default_phantom_options(PhantomKind::Slip, 3);
    phantom.size = {run.is_quick() ? 32 : 64, run.is_quick() ? 32 : 64, 10};
    phantom.spacing = {1, 1, 10};
    RegistrationOptions options = defaults();
    options.pyramid.finest_level = 0;
    if (run.is_quick()) options.optimisation.max_iterations = 30;
    return measure<3>("spacing 1 x 1 x 10", pair_of<3>(phantom), options);
  });
  run.add("3 slices", [&] {
    PhantomOptions phantom = default_phantom_options(PhantomKind::Slip, 3);
    phantom.size = {run.is_quick() ? 40 : 64, run.is_quick() ? 40 : 64, 8};
    ImageGrid<3> grid = phantom_grid<3>(phantom);
    grid.size[2] = 3;
    grid.origin[2] = 2;  // inside the scene, whose own border does not count
    RegistrationOptions options = defaults();
    options.pyramid.finest_level = 0;
    if (run.is_quick()) options.optimisation.max_iterations = 30;
    return measure<3>(
        "3 slices", pair_of<3>(std::shared_ptr<const Scene<3>>(make_scene<3>(phantom)), grid, phantom.noise), options);
  });
  run.add("2 x 2 images", [] {
    const auto pair = pair_without_truth(
        square(2), [](int x, int y) { return float(x + 2 * y); }, [](int x, int y) { return float(y + 2 * x); });
    return measure<2>("2 x 2 images", pair, defaults());
  });
}

void add_contents(Run& run) {
  const ImageGrid<2> grid = square(32);
  const auto texture = [](int x, int y) { return float(std::sin(0.4 * x) * std::cos(0.3 * y)); };
  const auto constant = [](float value) { return [value](int, int) { return value; }; };
  const auto still = [](const std::string& name, const Pair<2>& pair) {
    std::optional<RegistrationResult<2>> result;
    Row row = measure<2>(name, pair, defaults(), Expected::Result, &result);
    if (result && largest_difference(result->displacement, VectorVolume<2>(pair.input.fixed.grid)) > 0)
      row.complaints.push_back("something moved");
    return row;
  };
  run.add("constant images, equal",
          [&] { return still("constant images, equal", pair_without_truth(grid, constant(7), constant(7))); });
  run.add("constant images, different",
          [&] { return still("constant images, different", pair_without_truth(grid, constant(7), constant(-300))); });
  run.add("fixed image constant",
          [&] { return still("fixed image constant", pair_without_truth(grid, constant(7), texture)); });
  run.add("moving image constant",
          [&] { return still("moving image constant", pair_without_truth(grid, texture, constant(7))); });
  run.add("no overlap", [&] {
    Pair<2> pair = pair_without_truth(grid, texture, texture);
    pair.input.moving.grid.origin = {1000, 1000};
    return measure<2>("no overlap", pair, defaults(), Expected::Refusal);
  });
  for (const auto& [what, value] :
       {std::pair{"NaN", std::numeric_limits<float>::quiet_NaN()}, {"Inf", std::numeric_limits<float>::infinity()}}) {
    const std::string name = std::string(what) + " in the moving image";
    run.add(name, [&] {
      Pair<2> pair = pair_without_truth(grid, texture, texture);
      pair.input.moving.samples[100] = value;
      return measure<2>(name, pair, defaults(), Expected::Refusal);
    });
  }
}

void add_intensities(Run& run) {
  const auto changed = [&](const std::string& name, double factor, double offset) {
    run.add(name, [&, factor, offset] {
      Pair<2> pair = pair_of<2>(slip(run, 6));
      for (Volume<2>* image : {&pair.input.fixed, &pair.input.moving})
        for (float& sample : image->samples) sample = static_cast<float>(factor * sample + offset);
      return measure<2>(name, pair, defaults());
    });
  };
  changed("intensity x 1e-6", 1e-6, 0);
  changed("intensity x 1e6", 1e6, 0);
  changed("intensity + 32768", 1, 32768);
  changed("intensity - 65536", 1, -65536);
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc}) {
    const std::string name = "noise at SNR 1, " + to_string(similarity);
    run.add(name, [&, similarity] {
      // Noise as strong as the texture: its standard deviation over the range is measured, not guessed.
      PhantomOptions phantom = slip(run, 6);
      phantom.noise = 0;
      const std::vector<float> samples = make_phantom<2>(phantom).moving.samples;
      double sum = 0, squares = 0;
      for (float v : samples) sum += v, squares += double(v) * v;
      const double n = static_cast<double>(samples.size()), sd = std::sqrt(squares / n - sum * sum / (n * n));
      const auto [low, high] = std::minmax_element(samples.begin(), samples.end());
      phantom.noise = sd / (*high - *low);
      return measure<2>(name, pair_of<2>(phantom), defaults(similarity));
    });
  }
}

/// Bright for dark in the fixed image, which a similarity for images of different kinds must not mind: it is to find at
/// least half of the motion.
void add_contrasts(Run& run) {
  for (SimilarityType similarity : {SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind}) {
    const std::string name = "contrast inversion, " + to_string(similarity);
    run.add(name, [&, similarity] {
      Pair<2> pair = pair_of<2>(slip(run, 6));
      for (float& sample : pair.input.fixed.samples) sample = 255 - sample;
      Row row = measure<2>(name, pair, defaults(similarity));
      const double *before = row.find("before_mm"), *error = row.find("error_mm");
      if (!before || !error || !(*error < 0.5 * *before)) row.complaints.push_back("the motion is not found");
      return row;
    });
  }
}

void add_machine(Run& run) {
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc}) {
    const std::string name = "float against double, " + to_string(similarity);
    run.add(name, [&, similarity] {
      PhantomOptions phantom = slip(run, 6);
      phantom.size = {64, 64, 1};
      RegistrationOptions options = defaults(similarity);
      options.momenta.width_voxels = 6;
      options.momenta.scales = 3;
      options.momenta.finest_scale = options.momenta.first_order_finest_scale = 0;
      options.momenta.orientations = 0;  // one round from a given start: nothing is turned
      options.optimisation.max_iterations = 20;
      options = resolved(options, Lattice<2>{{64, 64}, {1, 1}, {}});
      return compare_precision<2>(name, pair_of<2>(phantom), options);
    });
  }
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc}) {
    const std::string name = "1, 2 and 8 threads, " + to_string(similarity);
    run.add(name, [&, similarity] {
      PhantomOptions phantom = slip(run, 6);
      phantom.size = {64, 64, 1};
      const Pair<2> pair = pair_of<2>(phantom);
      RegistrationOptions options = defaults(similarity);
      options.optimisation.max_iterations = 20;
      std::optional<RegistrationResult<2>> alone, together;
      Row row = measure<2>(name, pair, options, Expected::Result, &alone);
      int differ = 0;
      for (int threads : {2, 8}) {
        options.threads = threads;
        measure<2>(name, pair, options, Expected::Result, &together);
        differ += !alone || !together || alone->displacement.samples != together->displacement.samples ||
                  alone->inverse_displacement.samples != together->inverse_displacement.samples ||
                  alone->summary.similarity_after != together->summary.similarity_after;
      }
      row.add("threads_differ", differ);
      if (differ > 0) row.complaints.push_back("threads change the result");
      return row;
    });
  }
}

}  // namespace

std::vector<Row> hard_case_rows(bool is_quick, const std::string& only, std::ostream& log) {
  Run run(is_quick, only, log);
  add_large_motion(run);
  add_slips(run);
  add_interfaces(run);
  for (const Row& row : trajectory_rows(only)) run.add(row.name, [&] { return row; });
  add_discretisation(run);
  add_shapes(run);
  add_contents(run);
  add_intensities(run);
  add_contrasts(run);
  add_machine(run);
  return std::move(run).rows();
}

const std::vector<Column>& hard_case_columns() {
  static const std::vector<Column> columns = {{"before_mm", "before, mm"},
                                              {"error_mm", "error, mm"},
                                              {"near_mm", "within 3 voxels"},
                                              {"folds_percent", "folds off it, %", 3},
                                              {"opening_mm", "opening, mm"},
                                              {"closing_mm", "closing, mm"},
                                              {"inverse_p95_voxels", "inverse, 95 %, voxels", 3},
                                              {"inverse_from_fixed_p95_voxels", "from fixed", 3},
                                              {"hamiltonian_drift", "H drift", 4},
                                              {"energy_rises", "rises", 0},
                                              {"threads_differ", "threads differ", 0},
                                              {"float_mean_voxels", "float - double, voxels", 4},
                                              {"float_max_voxels", "max", 4},
                                              {"float_gradient_relative", "float gradient, relative", 6},
                                              {"iterations", "iterations", 0},
                                              {"cpu_seconds", "CPU s", 1}};
  return columns;
}

}  // namespace saltus::benchmark
