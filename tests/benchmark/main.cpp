#ifdef _OPENMP
#include <omp.h>
#endif

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/registration/options.h"
#include "tests/benchmark/block_costs.h"
#include "tests/benchmark/hard_cases.h"
#include "tests/benchmark/kernel_costs.h"
#include "tests/benchmark/peers/peers.h"
#include "tests/benchmark/scale.h"
#include "tests/benchmark/slip_table.h"
#include "tests/benchmark/throughput.h"

namespace {

using namespace saltus::benchmark;

/// Prints, writes, and gives the exit code: 1 when a row has a complaint.
int finish(const std::vector<Column>& columns, const std::vector<Row>& rows, const std::string& json_file) {
  print_markdown(std::cout, columns, rows);
  if (!json_file.empty()) {
    std::ofstream file(json_file);
    file << as_json(rows).dump(1) << '\n';
    file.close();
    if (!file) {
      std::cerr << json_file << " could not be written\n";
      return 2;
    }
  }
  return std::any_of(rows.begin(), rows.end(), [](const Row& row) { return !row.complaints.empty(); }) ? 1 : 0;
}

void add_peers(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand(
      "peers",
      "Presets of saltus beside other installed programs: error against CPU time. Can be interrupted: what was "
      "measured under the same setting is not run again");
  static PeersOptions options;
  options.data = SALTUS_SHARED_DATA;
  options.program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "saltus";
  command->add_option("--out", options.out, "Folder of runs.json, table.md and error_against_time.svg")->required();
  command->add_option("--data", options.data, "Folder of the shared images")->envname("SALTUS_SHARED_DATA");
  command->add_option("--program", options.program, "The saltus to measure, beside its saltusd and saltus-worker");
  command->add_option("--methods", options.methods, "Of saltus, elastix and plastimatch")->delimiter(',');
  command->add_option("--models", options.models, "Of saltus")->delimiter(',');
  command->add_option("--presets", options.presets, "Of saltus")->delimiter(',');
  command->add_option("--threads", options.threads, "Each of these numbers of threads")->delimiter(',');
  command->add_option("--sizes", options.sizes, "Phantoms of so many times the voxels along each axis")->delimiter(',');
  command->add_option("--only", options.only, "Runs whose 'pair, method' contains this")->type_name("TEXT");
  command->add_option("--publish", options.publish, "Root of the sources: puts table and plot into its documentation");
  command->add_flag("--fresh", options.is_fresh, "Measure again what was measured before");
  command->callback([&exit_code] {
    try {
      exit_code = run_peers(options, std::cerr) ? 0 : 1;
    } catch (const std::exception& error) {
      std::cerr << error.what() << '\n';
      exit_code = 2;
    }
  });
}

}  // namespace

int main(int argument_count, char** arguments) {
#ifdef _OPENMP
  omp_set_num_threads(1);  // what is not a registration; those have their own number
#endif
  CLI::App app("Measures registrations of scenes whose truth is known, and what their parts cost");
  app.require_subcommand(1);
  std::string json_file, only;
  bool is_quick = false;
  int exit_code = 0;
  const auto add = [&](const char* name, const char* description) {
    CLI::App* command = app.add_subcommand(name, description);
    command->add_option("--json", json_file, "Write all figures there")->type_name("FILE");
    command->add_flag("--quick", is_quick, "Smaller images, fewer cases");
    return command;
  };
  CLI::App* hard =
      add("hard-cases", "Cases that must end in a result or a named refusal; exit code 1 when one does not");
  hard->add_option("--only", only, "Cases whose name contains this")->type_name("TEXT");
  hard->callback(
      [&] { exit_code = finish(hard_case_columns(), hard_case_rows(is_quick, only, std::cerr), json_file); });
  add("slip", "Every model on a slip of 6 px along lines and a circle")->callback([&] {
    exit_code = finish(slip_columns(), slip_rows(is_quick, std::cerr), json_file);
  });
  add("blocks", "What active and inactive blocks of first-order momenta cost")->callback([&] {
    exit_code = finish(block_cost_columns(), block_cost_rows(is_quick, std::cerr), json_file);
  });
  add("kernels", "The hot loops beside what the machine can do, with one thread and two")->callback([&] {
    exit_code = finish(kernel_columns(), kernel_rows(is_quick, std::cerr), json_file);
  });
  std::vector<int> sizes{64, 96, 128, 192, 256, 384};
  std::string scale_model = to_string(saltus::RegistrationOptions{}.model);
  std::filesystem::path out;
  CLI::App* scale = add("scale", "Time and memory against the size of the images, 64^3 to 384^3, each in its process");
  scale->add_option("--sizes", sizes, "Voxels an axis")->delimiter(',');
  scale->add_option("--model", scale_model, "Which model")->capture_default_str();
  scale->add_option("--out", out, "Folder of scale.svg and of what the runs say")->required();
  scale->callback([&] {
    const auto rows = scale_rows("/proc/self/exe", sizes, scale_model, out, std::cerr);
    if (std::any_of(rows.begin(), rows.end(), [](const Row& row) { return row.find("voxels") != nullptr; }))
      std::ofstream(out / "scale.svg") << to_svg(plot_of_scale(rows));
    exit_code = finish(scale_columns(), rows, json_file);
  });
  int child_size = 0;
  CLI::App* child = app.add_subcommand("scale-child", "One run of scale")->group("");
  child->add_option("size", child_size)->required()->check(CLI::Range(16, 1024));
  child->add_option("model", scale_model)->required();
  child->callback([&] { run_scale_child(child_size, scale_model, std::cout); });
  ThroughputOptions throughput;
  throughput.programs = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  CLI::App* pairs = add("throughput", "Many pairs on this machine, divided into jobs and threads in every way");
  pairs->add_option("--out", throughput.out, "Folder of images and results")->required();
  pairs->add_option("--pairs", throughput.pairs, "How many")->check(CLI::Range(1, 1000))->capture_default_str();
  pairs->add_option("--size", throughput.size, "Voxels across the thorax")
      ->check(CLI::Range(32, 512))
      ->capture_default_str();
  pairs->add_option("--settings", throughput.settings, "JOBSxTHREADS, as 2x1,1x2 [all that fill the cores]")
      ->delimiter(',');
  pairs->callback([&] {
    if (is_quick) {
      throughput.pairs = 2;
      throughput.size = 32;
    }
    try {
      exit_code = finish(throughput_columns(), throughput_rows(throughput, std::cerr), json_file);
    } catch (const std::exception& error) {
      std::cerr << error.what() << '\n';
      exit_code = 2;
    }
  });
  add_peers(app, exit_code);
  CLI11_PARSE(app, argument_count, arguments);
  return exit_code;
}
