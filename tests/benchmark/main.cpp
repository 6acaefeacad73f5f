#ifdef _OPENMP
#include <omp.h>
#endif

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "tests/benchmark/block_costs.h"
#include "tests/benchmark/hard_cases.h"
#include "tests/benchmark/slip_table.h"

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

}  // namespace

int main(int argument_count, char** arguments) {
#ifdef _OPENMP
  omp_set_num_threads(1);  // what is not a registration; those have their own number
#endif
  CLI::App app("Measures registrations of scenes whose truth is known, in this process and in one thread");
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
  CLI11_PARSE(app, argument_count, arguments);
  return exit_code;
}
