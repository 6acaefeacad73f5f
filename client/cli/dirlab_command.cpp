#include "client/cli/dirlab_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/cli/dirlab_pack.h"
#include "client/cli/dirlab_scores.h"
#include "client/cli/register_pairs.h"
#include "client/cli/statistics_json.h"
#include "client/cli/transform_folder.h"
#include "core/evaluation/field_error.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_transform.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <memory>
#include <set>
#include <sstream>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

// The published errors have two decimals.
constexpr double agreement_mm = 0.0051;

struct DirlabOptions {
  std::string root, out;
  std::string cases = "1-10";
  std::vector<std::string> models = comparable_models();
  std::vector<double> initial_errors;  ///< in place of the published ones, for other data in the same layout
  bool only_check = false;
  JobOptions job;
  int jobs = 0;
  ServerChoice server;
  bool as_json = false;
};

/// "1-3,7" -> 1, 2, 3, 7.
std::vector<int> parse_cases(const std::string& text) {
  const InvalidInput error("--cases is " + text + "; it must be numbers and ranges from 1 to 10, such as 1-5,8");
  std::set<int> cases;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    const auto number = [&error](std::string_view word) {
      int value = 0;
      const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), value);
      if (problem != std::errc() || end != word.data() + word.size() || value < 1 || value > 10) throw error;
      return value;
    };
    const auto dash = part.find('-');
    const int first = number(std::string_view(part).substr(0, dash));
    const int last = dash == std::string::npos ? first : number(std::string_view(part).substr(dash + 1));
    if (last < first) throw error;
    for (int i = first; i <= last; ++i) cases.insert(i);
  }
  if (cases.empty()) throw error;
  return {cases.begin(), cases.end()};
}

/// A case with everything of its pack but the voxels.
struct OpenCase {
  DirlabCase about;
  DirlabPaths paths;
  std::vector<Vector<3>> fixed, moving;  ///< inhale is what stays, as in the paper
  double initial_error_mm = 0;

  std::string name() const { return (about.number < 10 ? "case0" : "case") + std::to_string(about.number); }
};

/// The coordinates are right when the errors before registration are those that everybody finds.
std::vector<OpenCase> open_cases(const DirlabOptions& options) {
  const std::vector<int> numbers = parse_cases(options.cases);
  if (!options.initial_errors.empty() && options.initial_errors.size() != numbers.size())
    throw InvalidInput("--initial-errors has " + std::to_string(options.initial_errors.size()) + " values for " +
                       std::to_string(numbers.size()) + " cases; give one for each");
  std::vector<OpenCase> cases;
  std::string wrong;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    OpenCase one{dirlab_cases()[static_cast<std::size_t>(numbers[i] - 1)],
                 find_dirlab_case(options.root, numbers[i]),
                 {},
                 {},
                 0};
    if (!options.initial_errors.empty()) one.about.initial_error_mm = options.initial_errors[i];
    one.fixed = read_dirlab_points(one.paths.inhale_points, one.about);
    one.moving = read_dirlab_points(one.paths.exhale_points, one.about);
    one.initial_error_mm = summarise(landmark_distances(one.fixed, one.moving)).mean;
    std::ostringstream line;
    line << std::fixed << std::setprecision(2) << one.name() << ": " << one.fixed.size()
         << " landmarks, before registration " << one.initial_error_mm << " mm (expected " << one.about.initial_error_mm
         << ")";
    std::cerr << line.str() << std::endl;
    if (!(std::abs(one.initial_error_mm - one.about.initial_error_mm) <= agreement_mm))
      wrong += (wrong.empty() ? "" : "; ") + line.str();
    cases.push_back(std::move(one));
  }
  if (!wrong.empty())
    throw InvalidInput("the landmarks below --root are not those of DIR-Lab's cases, or were changed: " + wrong);
  return cases;
}

/// Writes a case as images and landmarks that every other command takes.
Pair prepare(const OpenCase& one, const fs::path& folder, const JobOptions& common) {
  fs::create_directories(folder);
  const auto file = [&](const std::string& name) { return (folder / (one.name() + name)).string(); };
  write_volume(file("_inhale.mha"), read_dirlab_image(one.paths.inhale, one.about));
  write_volume(file("_exhale.mha"), read_dirlab_image(one.paths.exhale, one.about));
  write_points(file("_inhale.csv"), one.fixed);
  write_points(file("_exhale.csv"), one.moving);
  Pair pair{one.name(), common};
  pair.job.fixed = file("_inhale.mha");
  pair.job.moving = file("_exhale.mha");
  pair.job.fixed_points = file("_inhale.csv");
  pair.job.moving_points = file("_exhale.csv");
  return pair;
}

/// Scores of every model, case by case, and of all landmarks together.
struct Scores {
  std::map<std::string, std::map<int, LandmarkScores>> by_model;

  LandmarkScores pooled(const std::string& model) const {
    LandmarkScores all;
    for (const auto& [number, scores] : by_model.at(model)) {
      all.raw.insert(all.raw.end(), scores.raw.begin(), scores.raw.end());
      all.snapped.insert(all.snapped.end(), scores.snapped.begin(), scores.snapped.end());
    }
    return all;
  }
};

nlohmann::json table(const std::vector<OpenCase>& cases, const std::vector<std::string>& models, const Scores& scores) {
  nlohmann::json json;
  for (const std::string& model : models) {
    nlohmann::json& of_model = json["models"][model];
    for (const OpenCase& one : cases) {
      const LandmarkScores& found = scores.by_model.at(model).at(one.about.number);
      nlohmann::json& row = of_model["cases"][one.name()];
      row = {{"raw_mm", as_json(summarise(found.raw))}, {"snapped_mm", as_json(summarise(found.snapped))}};
      if (const auto paper = paper_errors(one.about.number); paper.contains(model)) row["paper_mm"] = paper.at(model);
    }
    const LandmarkScores all = scores.pooled(model);
    of_model["pooled"] = {{"raw_mm", as_json(summarise(all.raw))}, {"snapped_mm", as_json(summarise(all.snapped))}};
    if (model == models.back()) continue;
    const SignedRank test = signed_rank_test(scores.pooled(models.back()).raw, all.raw);
    of_model["wilcoxon_against_" + models.back()] = {{"z", test.z}, {"p", test.p}};
  }
  for (const OpenCase& one : cases) json["before_mm"][one.name()] = one.initial_error_mm;
  return json;
}

void print(const nlohmann::json& json, const std::vector<OpenCase>& cases, const std::vector<std::string>& models) {
  std::cout << std::fixed << std::setprecision(2);
  const auto line = [](const nlohmann::json& s) {
    for (const char* column : {"mean", "sd", "median", "p90"}) std::cout << std::setw(8) << s.at(column).get<double>();
  };
  std::cout << "Target registration error, mm: raw and snapped to the voxel, each mean, sd, median, 90th percentile\n"
            << std::left << std::setw(8) << "case" << std::setw(12) << "model" << std::right << std::setw(8) << "before"
            << std::setw(8) << "paper" << std::setw(32) << "raw" << std::setw(32) << "snapped" << '\n';
  for (const OpenCase& one : cases)
    for (const std::string& model : models) {
      const nlohmann::json& row = json["models"][model]["cases"][one.name()];
      std::cout << std::left << std::setw(8) << one.name() << std::setw(12) << model << std::right << std::setw(8)
                << one.initial_error_mm << std::setw(8);
      if (row.contains("paper_mm"))
        std::cout << row["paper_mm"].get<double>();
      else
        std::cout << "-";
      line(row["raw_mm"]);
      line(row["snapped_mm"]);
      std::cout << '\n';
    }
  for (const std::string& model : models) {
    const nlohmann::json& row = json["models"][model]["pooled"];
    std::cout << std::left << std::setw(8) << "pooled" << std::setw(12) << model << std::right << std::setw(16) << "";
    line(row["raw_mm"]);
    line(row["snapped_mm"]);
    std::cout << '\n';
  }
  for (const std::string& model : models) {
    const std::string key = "wilcoxon_against_" + models.back();
    if (!json["models"][model].contains(key)) continue;
    const nlohmann::json& test = json["models"][model][key];
    std::cout << models.back() << " against " << model << ": Wilcoxon signed rank of the raw errors, z "
              << test["z"].get<double>() << ", p " << std::defaultfloat << std::setprecision(3)
              << test["p"].get<double>() << std::fixed << std::setprecision(2) << '\n';
  }
  std::cout << std::flush;
}

int run(const DirlabOptions& options) {
  const std::vector<OpenCase> cases = open_cases(options);
  if (options.only_check) return Done;
  if (options.out.empty()) throw InvalidInput("--out is missing; name a folder for the results");
  for (const std::string& model : options.models) parse_model(model);
  std::vector<Pair> pairs;
  for (const OpenCase& one : cases) pairs.push_back(prepare(one, fs::path(options.out) / "images", options.job));
  Scores scores;
  for (const std::string& model : options.models) {
    std::cerr << "model " << model << std::endl;
    for (Pair& pair : pairs) pair.job.model = model;
    const fs::path folder = fs::path(options.out) / model;
    // Resumes by itself: what is done is not done again.
    if (const int code =
            register_pairs(pairs, {options.job, options.server, "", folder, false, options.jobs, PairsOutput::Silent});
        code != Done)
      return code;
    for (const OpenCase& one : cases) {
      const auto file = displacement_file(folder / one.name(), TransformDirection::Forward);
      scores.by_model[model][one.about.number] = score_landmarks(read_displacement<3>(file), one.fixed, one.moving);
    }
  }
  const nlohmann::json json = table(cases, options.models, scores);
  if (options.as_json)
    std::cout << json.dump(2) << std::endl;
  else
    print(json, cases, options.models);
  return Done;
}

}  // namespace

void add_dirlab_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("dirlab", "The paper's table, from your own DIR-Lab 4-D CT packs");
  auto options = std::make_shared<DirlabOptions>();
  options->job.intensity_window = "50,1200";
  options->job.format = "mha";
  command->add_option("--root", options->root, "Folder with the unpacked packs, at any depth")
      ->type_name("DIR")
      ->required()
      ->check(CLI::ExistingDirectory);
  command->add_option("--out", options->out, "Folder for images, results and tables; run again, it goes on")
      ->type_name("DIR");
  command->add_option("--cases", options->cases, "Numbers and ranges, e.g. 1-5,8")->capture_default_str();
  command
      ->add_option("--models", options->models, "Compared one after the other; the last is tested against the others")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--similarity", options->job.similarity, "As of register")->capture_default_str();
  command->add_option("--preset", options->job.preset, "fast, balanced or accurate")->capture_default_str();
  command->add_option("--affine", options->job.affine, "Start: none, rigid or affine")->capture_default_str();
  command->add_option("--intensity-window", options->job.intensity_window, "Raw values, HU + about 1000")
      ->type_name("LO,HI")
      ->capture_default_str();
  command->add_option("--set", options->job.settings, "Expert parameter, as of register; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--threads", options->job.threads, "Threads of the solver; 0: as many as the server gives")
      ->type_name("N")
      ->check(CLI::NonNegativeNumber);
  add_jobs_option(*command, options->jobs);
  command
      ->add_option("--initial-errors", options->initial_errors,
                   "Expected errors before registration, mm, for other data in the same layout")
      ->delimiter(',')
      ->type_name("MM,...");
  command->add_flag("--only-check", options->only_check, "Only read the landmarks and prove their coordinates");
  command->add_option("--server", options->server.address, "Address of saltusd; without it a private one")
      ->type_name("ADDRESS");
  add_tls_options(*command, options->server);
  command->add_flag("--json", options->as_json, "Print the table as JSON");
  command->footer(
      "Inhale (T00) is fixed, exhale (T50) moving. Before anything is registered the mean distances of the landmarks\n"
      "must be the published ones: 3.89 4.34 6.94 9.83 7.48 10.89 11.03 14.99 7.92 7.30 mm.\n"
      "Examples:\n"
      "  saltus dirlab --root packs --only-check\n"
      "  saltus dirlab --root packs --cases 1-5 --out dirlab");
  command->callback([options, &exit_code] { exit_code = run(*options); });
}

}  // namespace saltus::cli
