#include "tests/benchmark/scale.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <limits>
#include <ostream>
#include <sstream>
#include <stdexcept>
#include <string>

#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "core/support/stopwatch.h"
#include "tests/benchmark/measured_process.h"

namespace saltus::benchmark {
namespace {

/// Iterations of a level: enough for what they cost to show above all else, few enough for the largest images.
constexpr int kIterations = 8;

RegistrationOptions options_of(const std::string& model) {
  RegistrationOptions options = default_options(parse_model(model), SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.optimisation.max_iterations = kIterations;
  options.optimisation.tolerance = options.optimisation.optimality_tolerance = 0;  // the same work at every size
  // Nor may it hang on what each size shows of the pleura whether first orders take part.
  if (options.momenta.first_order_shear != 0) options.momenta.first_order_shear = std::numeric_limits<double>::max();
  return options;
}

/// What Linux would give without taking it from another program; without limit where it does not say.
double available_bytes() {
  std::ifstream file("/proc/meminfo");
  for (std::string name, unit; file >> name;) {
    double kibibytes = 0;
    if (name == "MemAvailable:" && file >> kibibytes) return 1024 * kibibytes;
    std::getline(file, unit);
  }
  return std::numeric_limits<double>::infinity();
}

std::string gibibytes(double bytes) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(1) << bytes / (1024.0 * 1024.0 * 1024.0);
  return text.str();
}

}  // namespace

void run_scale_child(int size, const std::string& model, std::ostream& out) {
  const RegistrationOptions options = options_of(model);
  PhantomOptions scene = default_phantom_options(PhantomKind::Thorax);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    scene.spacing[axis] *= static_cast<double>(scene.size[axis]) / size;
    scene.size[axis] = size;
  }
  RegistrationInput<3> input;
  {
    Phantom<3> phantom = make_phantom<3>(scene);
    input.fixed = std::move(phantom.fixed);
    input.moving = std::move(phantom.moving);
  }
  const Stopwatch watch;
  const RegistrationResult<3> result = register_images<3>(input, options);
  const double mib = 1024.0 * 1024.0;
  out << watch.cpu_seconds() << ' ' << result.summary.history.size() << ' '
      << static_cast<double>(memory_estimate<3>(input.fixed.grid, input.moving.grid, options)) / mib << std::endl;
}

std::vector<Row> scale_rows(const std::filesystem::path& program, const std::vector<int>& sizes,
                            const std::string& model, const std::filesystem::path& folder, std::ostream& progress) {
  std::filesystem::create_directories(folder);
  std::vector<Row> rows;
  double bytes_a_voxel = 0;
  for (int size : sizes) {
    const double wanted = 1.1 * bytes_a_voxel * std::pow(size, 3), available = available_bytes();
    if (wanted > available) {
      rows.push_back({std::to_string(size) + "^3",
                      "left out: about " + gibibytes(wanted) + " GiB where " + gibibytes(available) + " are free",
                      {},
                      {}});
      progress << rows.back().name << ' ' << rows.back().outcome << std::endl;
      continue;
    }
    const std::filesystem::path log = folder / ("scale_" + std::to_string(size) + ".txt");
    const ProcessCost cost = run_measured({program, "scale-child", std::to_string(size), model},
                                          {{"OMP_WAIT_POLICY", "passive"}, {"OMP_NUM_THREADS", "1"}}, log);
    Row row;
    row.name = std::to_string(size) + "^3";
    std::ifstream file(log);
    double cpu = 0, iterations = 0, declared = 0;
    if (cost.exit_code != 0 || !(file >> cpu >> iterations >> declared)) {
      row.outcome = "ended with exit code " + std::to_string(cost.exit_code) + ", see " + log.string();
      row.complaints.push_back("a result is expected");
      rows.push_back(std::move(row));
      continue;
    }
    row.outcome = "done";
    const double voxels = std::pow(size, 3);
    row.add("voxels", voxels);
    row.add("iterations", iterations);
    row.add("cpu_seconds", cpu);
    row.add("microseconds_a_voxel", 1e6 * cpu / voxels);
    row.add("peak_megabytes", cost.peak_megabytes);
    row.add("declared_megabytes", declared);
    row.add("share_of_declared", 100 * cost.peak_megabytes / declared);
    bytes_a_voxel = cost.peak_megabytes * 1024 * 1024 / voxels;
    row.add("bytes_a_voxel", bytes_a_voxel);
    if (cost.peak_megabytes > 1.1 * declared) row.complaints.push_back("more memory than it declares");
    progress << row.name << ": " << cpu << " CPU s, " << cost.peak_megabytes << " of " << declared << " MiB"
             << std::endl;
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<Column> scale_columns() {
  return {{"iterations", "iterations", 0},
          {"cpu_seconds", "CPU s", 1},
          {"microseconds_a_voxel", "microseconds a voxel", 2},
          {"peak_megabytes", "peak MiB", 0},
          {"declared_megabytes", "declared MiB", 0},
          {"share_of_declared", "of it, %", 0},
          {"bytes_a_voxel", "bytes a voxel", 0}};
}

ScatterPlot plot_of_scale(const std::vector<Row>& rows) {
  ScatterPlot plot;
  plot.title = "Time and memory against size";
  plot.subtitle = "Thorax phantom in N x N x N voxels, one thread, " + std::to_string(kIterations) +
                  " iterations a level and round; the same takes part at every size.";
  plot.x_label = "million voxels (logarithmic)";
  plot.columns = 2;
  const auto curve = [&](const std::string& name, const char* key, bool has_labels) {
    PlotSeries series;
    series.name = name;
    series.is_connected = true;
    for (const Row& row : rows) {
      const double *x = row.find("voxels"), *y = row.find(key);
      if (x && y) series.points.push_back({1e-6 * *x, *y, has_labels ? row.name : ""});
    }
    return series;
  };
  const auto panel = [&](const std::string& title, const std::string& unit, std::vector<PlotSeries> series) {
    if (series.front().points.empty()) return;
    PlotPanel one;
    one.title = title;
    one.y_label = unit;
    one.has_log_y = true;
    one.note = "dashed: proportional to the number of voxels";
    PlotSeries line;
    line.name = "proportional";
    line.is_connected = line.is_dashed = true;
    const PlotPoint &first = series.front().points.front(), &last = series.front().points.back();
    line.points = {{first.x, last.y * first.x / last.x, ""}, {last.x, last.y, ""}};
    one.series = std::move(series);
    one.series.push_back(std::move(line));
    plot.panels.push_back(std::move(one));
  };
  panel("Time of the registration", "CPU s", {curve("measured", "cpu_seconds", true)});
  panel("Largest memory", "MiB",
        {curve("measured", "peak_megabytes", true), curve("declared", "declared_megabytes", false)});
  return plot;
}

}  // namespace saltus::benchmark
