#include "tests/benchmark/peers/peers.h"

#include <algorithm>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <map>
#include <ostream>
#include <set>
#include <sstream>
#include <stdexcept>
#include <tuple>

#include "core/support/fingerprint.h"
#include "tests/benchmark/peers/methods.h"

namespace saltus::benchmark {
namespace {

std::vector<std::unique_ptr<Method>> find_methods(const PeersOptions& options, std::ostream& log) {
  std::vector<std::unique_ptr<Method>> methods;
  for (const std::string& name : options.methods) {
    if (name == "saltus") {
      for (const std::string& model : options.models)
        for (const std::string& preset : options.presets)
          methods.push_back(make_saltus(options.program, model, preset));
    } else if (name == "elastix") {
      const auto elastix = find_program("elastix"), transformix = find_program("transformix");
      if (elastix.empty() || transformix.empty())
        log << "elastix and transformix are not in PATH (Debian package elastix): left out\n";
      else
        methods.push_back(make_elastix(elastix, transformix));
    } else if (name == "plastimatch") {
      const auto program = find_program("plastimatch");
      if (program.empty())
        log << "plastimatch is not in PATH (Debian package plastimatch): left out\n";
      else
        // None is good everywhere: one for images without texture, one for those with.
        for (const char* smoothness : {"0.005", "1"}) methods.push_back(make_plastimatch(program, smoothness));
    } else {
      throw std::runtime_error("method '" + name + "' is none of saltus, elastix, plastimatch");
    }
  }
  return methods;
}

std::uint64_t digest_of(const PeerPair& pair) {
  Fingerprint fingerprint;
  for (const auto& path : {pair.fixed, pair.moving}) {
    std::ifstream file(path, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    fingerprint.add(std::string_view(bytes));
  }
  return fingerprint.value();
}

void write_file(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file) throw std::runtime_error(path.string() + " could not be written");
}

const double* figure(const PeerRun& run, const char* key) { return run.row.find(key); }

std::string cell(const PeerRun& run, const char* key, int digits) {
  const double* value = figure(run, key);
  if (!value) return "";
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << *value;
  return out.str();
}

std::string method_and_threads(const PeerRun& run) {
  return run.threads == 1 ? run.method() : run.method() + ", " + std::to_string(run.threads) + " threads";
}

using MethodOrder = std::tuple<bool, std::string, int, std::string, int>;

/// This project's own first; a family from the cheapest setting to the dearest.
MethodOrder order_of(const PeerRun& run) {
  static const std::vector<std::string> choices{"", "fast", "balanced", "accurate"};
  const auto effort = std::find(choices.begin(), choices.end(), run.choice) - choices.begin();
  return {!run.family.starts_with("saltus"), run.family, static_cast<int>(effort), run.choice, run.threads};
}

}  // namespace

bool run_peers(const PeersOptions& options, std::ostream& log) {
  const std::filesystem::path work = options.out / "work";
  std::filesystem::create_directories(work);
  RunStore store(options.out / "runs.json");
  const auto methods = find_methods(options, log);
  std::vector<PeerPair> pairs;
  const auto has_wanted = [&](const std::string& pair) {
    return std::any_of(methods.begin(), methods.end(), [&](const auto& method) {
      return (pair + ", " + method->name()).find(options.only) != std::string::npos;
    });
  };
  bool wants_shared = false;
  for (const char* name : {"liver a1", "liver a2", "liver b1", "liver b2"}) wants_shared |= has_wanted(name);
  if (wants_shared && std::filesystem::is_directory(options.data)) {
    for (PeerPair& pair : shared_pairs(options.data)) pairs.push_back(std::move(pair));
  } else if (wants_shared) {
    log << "no shared images in " << options.data.string()
        << ", their pairs are left out; name their folder by --data or in SALTUS_SHARED_DATA\n";
  }
  for (int size : options.sizes)
    for (PeerPair& pair : phantom_pairs(size, work / "images")) pairs.push_back(std::move(pair));
  for (const PeerPair& pair : pairs)
    for (int threads : options.threads)
      for (const auto& method : methods) {
        PeerRun run{pair.scene, pair.name, method->family(), method->choice(), threads, {}, {}};
        run.row.name = pair.name + ", " + method->name();
        if (run.row.name.find(options.only) == std::string::npos) continue;
        run.setting = method->setting(pair, threads) + "\nimages " + std::to_string(digest_of(pair));
        if (!options.is_fresh && store.find(run)) {
          log << run.row.name << ", " << threads << " threads: already measured\n";
          continue;
        }
        const std::filesystem::path folder = work / "run";
        std::filesystem::remove_all(folder);
        std::filesystem::create_directories(folder);
        const MethodRun measured = method->run(pair, threads, folder);
        run.row.outcome = "done";
        run.row.add("cpu_seconds", measured.cost.cpu_seconds);
        run.row.add("wall_seconds", measured.cost.wall_seconds);
        run.row.add("peak_megabytes", measured.cost.peak_megabytes);
        if (measured.registration_cpu >= 0) run.row.add("registration_cpu_seconds", measured.registration_cpu);
        score(pair, measured.displacement, measured.warped, run.row);
        log << run.row.name << ", " << threads << " threads: " << cell(run, "error_mm", 2) << " mm, "
            << cell(run, "cpu_seconds", 1) << " CPU s";
        for (const std::string& complaint : run.row.complaints) log << ", " << complaint;
        log << std::endl;
        store.put(std::move(run));
      }
  std::vector<PeerRun> means = means_by_scene(store.runs());
  if (means.empty()) return true;
  std::ostringstream table;
  print_peers(table, means);
  write_file(options.out / "table.md", table.str());
  write_file(options.out / "error_against_time.svg", to_svg(plot_of(means)));
  if (!options.publish.empty()) publish_peers(options.publish, means);
  return std::all_of(store.runs().begin(), store.runs().end(),
                     [](const PeerRun& run) { return run.row.complaints.empty(); });
}

std::vector<PeerRun> means_by_scene(const std::vector<PeerRun>& runs) {
  std::vector<std::string> scenes;
  for (const PeerRun& run : runs)
    if (std::find(scenes.begin(), scenes.end(), run.scene) == scenes.end()) scenes.push_back(run.scene);
  std::vector<PeerRun> means;
  for (const std::string& scene : scenes) {
    std::set<std::string> pairs;
    std::map<MethodOrder, std::vector<const PeerRun*>> methods;
    for (const PeerRun& run : runs) {
      if (run.scene != scene) continue;
      pairs.insert(run.pair);
      methods[order_of(run)].push_back(&run);
    }
    for (const auto& [order, same] : methods) {
      if (same.size() != pairs.size()) continue;
      PeerRun mean = *same.front();
      mean.pair = pairs.size() == 1 ? mean.pair : std::to_string(pairs.size()) + " pairs";
      mean.row.figures.clear();
      mean.row.complaints.clear();
      for (const PeerRun* run : same) {
        for (const std::string& complaint : run->row.complaints) mean.row.complaints.push_back(complaint);
        for (const auto& [key, unused] : run->row.figures) {
          if (mean.row.find(key)) continue;
          double sum = 0, most = 0;
          int count = 0;
          for (const PeerRun* each : same)
            if (const double* value = each->row.find(key)) sum += *value, most = std::max(most, *value), ++count;
          const bool is_extreme = key.starts_with("worst") || key.starts_with("peak");
          mean.row.add(key, is_extreme ? most : sum / count);
        }
      }
      means.push_back(std::move(mean));
    }
  }
  return means;
}

void print_peers(std::ostream& out, const std::vector<PeerRun>& means) {
  out << "| scene (error before) | program | threads | error, mm | within 3 voxels / outside, mm | worst, mm | folds, "
         "% | "
         "CPU s, whole program | of that registering | wall s | peak MB |\n"
         "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n";
  std::string scene;
  for (const PeerRun& run : means) {
    out << "| ";
    if (run.scene != scene) {
      out << run.scene;
      if (run.pair != run.scene) out << ", " << run.pair;
      out << " (" << cell(run, "before_mm", 2);
      if (figure(run, "before_outside_mm")) out << " / " << cell(run, "before_outside_mm", 2);
      out << ')';
    }
    scene = run.scene;
    out << " | " << run.method();
    for (const std::string& complaint : run.row.complaints) out << " **" << complaint << "**";
    out << " | " << run.threads << " | " << cell(run, "error_mm", 2) << " | "
        << cell(run, figure(run, "outside_mm") ? "outside_mm" : "near_mm", 2) << " | " << cell(run, "worst_mm", 1)
        << " | " << cell(run, "folds_percent", 3) << " | " << cell(run, "cpu_seconds", 1) << " | "
        << cell(run, "registration_cpu_seconds", 1) << " | " << cell(run, "wall_seconds", 1) << " | "
        << cell(run, "peak_megabytes", 0) << " |\n";
  }
}

void print_peers_summary(std::ostream& out, const std::vector<PeerRun>& means) {
  std::vector<std::string> scenes;
  std::map<MethodOrder, std::string> methods;
  for (const PeerRun& run : means) {
    if (std::find(scenes.begin(), scenes.end(), run.scene) == scenes.end()) scenes.push_back(run.scene);
    methods[order_of(run)] = method_and_threads(run);
  }
  out << "| mean error, mm (/ within 3 voxels of the interface, liver: / outside it); CPU s |";
  for (const std::string& scene : scenes) out << ' ' << scene << " |";
  out << "\n|---|";
  for (std::size_t k = 0; k < scenes.size(); ++k) out << "---|";
  out << '\n';
  for (const auto& [order, method] : methods) {
    out << "| " << method << " |";
    for (const std::string& scene : scenes) {
      const auto run = std::find_if(means.begin(), means.end(), [&, &order = order](const PeerRun& each) {
        return each.scene == scene && order_of(each) == order;
      });
      out << ' ';
      if (run != means.end()) {
        out << cell(*run, "error_mm", 2);
        const char* second = figure(*run, "outside_mm") ? "outside_mm" : "near_mm";
        if (figure(*run, second)) out << " / " << cell(*run, second, 2);
        out << "; " << cell(*run, "cpu_seconds", 1);
      }
      out << " |";
    }
    out << '\n';
  }
}

void publish_peers(const std::filesystem::path& root, const std::vector<PeerRun>& means) {
  const std::filesystem::path readme = root / "README.md", picture = "deploy/pictures/error_against_time.svg";
  std::string text;
  {
    std::ifstream file(readme);
    text.assign(std::istreambuf_iterator<char>(file), {});
  }
  const std::string begin = "<!-- peers -->\n", end = "<!-- end of peers -->";
  const std::size_t from = text.find(begin), to = text.find(end);
  if (from == std::string::npos || to == std::string::npos || to < from)
    throw std::runtime_error(readme.string() + " has no lines '<!-- peers -->' and '<!-- end of peers -->'");
  std::ostringstream summary, table;
  summary << "![Error against CPU time of saltus and other programs](" << picture.string() << ")\n\n";
  print_peers_summary(summary, means);
  print_peers(table, means);
  write_file(root / picture, to_svg(plot_of(means)));
  write_file(root / "tests/benchmark/peers_table.md",
             "# Presets beside other programs\n\nWritten by `saltus-bench peers`; what it measures is in "
             "[README.md](README.md).\n\n" +
                 table.str());
  write_file(readme, text.substr(0, from + begin.size()) + summary.str() + text.substr(to));
}

ScatterPlot plot_of(const std::vector<PeerRun>& means) {
  int threads = means.empty() ? 1 : means.front().threads;
  for (const PeerRun& run : means) threads = std::min(threads, run.threads);
  ScatterPlot plot;
  plot.title = "Error against CPU time";
  plot.subtitle = "Each point one setting of one program, " + std::to_string(threads) +
                  (threads == 1 ? " thread" : " threads") +
                  "; user + system seconds of the whole program. Lower and further left is better.";
  plot.x_label = "CPU s (logarithmic)";
  const auto panel_of = [&](const std::string& scene, const char* error, const char* before, const std::string& title) {
    PlotPanel panel;
    panel.title = title;
    panel.y_label = "mean error, mm";
    for (const PeerRun& run : means) {
      const double *x = figure(run, "cpu_seconds"), *y = figure(run, error);
      if (run.scene != scene || run.threads != threads || !x || !y) continue;
      if (panel.note.empty())
        panel.note =
            figure(run, before) ? "before: " + cell(run, before, 2) + " mm" : "within 3 voxels of the interface";
      auto series = std::find_if(panel.series.begin(), panel.series.end(),
                                 [&](const PlotSeries& other) { return other.name == run.family; });
      if (series == panel.series.end()) {
        PlotSeries fresh;
        fresh.name = run.family;
        fresh.is_connected = run.family.starts_with("saltus");
        series = panel.series.insert(panel.series.end(), fresh);
      }
      series->points.push_back({*x, *y, run.choice.empty() ? run.family : run.choice});
    }
    if (!panel.series.empty()) plot.panels.push_back(std::move(panel));
  };
  std::string scene;
  for (const PeerRun& run : means) {
    if (run.scene == scene) continue;
    scene = run.scene;
    if (figure(run, "outside_mm")) {
      panel_of(scene, "error_mm", "before_mm", scene + ", inside the liver");
      panel_of(scene, "outside_mm", "before_outside_mm", scene + ", outside the liver");
    } else {
      panel_of(scene, "error_mm", "before_mm", scene);
      if (figure(run, "near_mm")) panel_of(scene, "near_mm", "", scene);
    }
  }
  plot.columns = plot.panels.size() > 9 ? 4 : plot.panels.size() == 4 ? 2 : 3;
  return plot;
}

}  // namespace saltus::benchmark
