#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "tests/benchmark/peers/run_store.h"
#include "tests/benchmark/scatter_plot.h"

namespace saltus::benchmark {

struct PeersOptions {
  std::filesystem::path out;      ///< runs.json, table.md, error_against_time.svg, and the images under work/
  std::filesystem::path data;     ///< of the shared images
  std::filesystem::path program;  ///< saltus, beside saltusd and saltus-worker
  std::vector<std::string> methods{"saltus", "elastix", "plastimatch"};
  std::vector<std::string> models{"auto"};
  std::vector<std::string> presets{"fast", "balanced", "accurate"};
  std::vector<int> threads{1};
  std::vector<int> sizes{1};
  std::string only;  ///< runs whose "pair, method" contains this
  bool is_fresh = false;
  std::filesystem::path publish;  ///< root of the sources, whose documentation gets table and plot; empty: none
};

/// Registers every pair with every method, one after the other, those that were not measured under the same setting
/// before; then writes table and plot of all runs there are. `log` gets a line for each run and for each program that
/// is not installed. Returns whether no run has a complaint.
bool run_peers(const PeersOptions& options, std::ostream& log);

/// Means over the pairs of a scene, for each method and number of threads; scenes and methods in the order of the runs.
/// Only methods that were run on all pairs of the scene.
std::vector<PeerRun> means_by_scene(const std::vector<PeerRun>& runs);

/// A table of means_by_scene.
void print_peers(std::ostream& out, const std::vector<PeerRun>& means);

/// A row for each method, a column for each scene: "error / near or outside; CPU s".
void print_peers_summary(std::ostream& out, const std::vector<PeerRun>& means);

/// Puts picture and tables where the documentation has them: the summary between the two lines of README.md that are
/// `<!-- peers -->` and `<!-- end of peers -->`, the whole table and the picture in files of their own. Throws
/// std::runtime_error that names the file when it cannot be written or has no such lines.
void publish_peers(const std::filesystem::path& root, const std::vector<PeerRun>& means);

/// Error against CPU seconds, a panel for each scene (two for one with outside landmarks), of the least number of
/// threads there is.
ScatterPlot plot_of(const std::vector<PeerRun>& means);

}  // namespace saltus::benchmark
