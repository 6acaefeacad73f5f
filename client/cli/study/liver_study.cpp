#include "client/cli/study/liver_study.h"

#include "client/cli/command.h"
#include "client/cli/statistics_json.h"
#include "client/cli/study/liver_pairs.h"
#include "core/drawing/markup.h"
#include "core/evaluation/jacobian.h"
#include "core/image_io/read_image.h"
#include "core/support/errors.h"

#include <nlohmann/json.hpp>

namespace saltus::cli {
namespace {

using drawing::number;
using drawing::percentage;

std::string run_name(const LiverPair& pair, const std::string& model, const std::string& preset) {
  return pair.name + "-" + model + "-" + preset;
}

/// The figures of one run.
struct Row {
  std::string pair, model, preset;  ///< "before" and "" for what was there at the start
  LiverErrors errors;
  double share_folded = 0, cpu_seconds = 0;
};

double mean(const std::vector<const Row*>& rows, double (*value)(const Row&)) {
  double sum = 0;
  for (const Row* row : rows) sum += value(*row);
  return sum / static_cast<double>(rows.size());
}

std::vector<std::string> cells(const std::vector<const Row*>& rows) {
  const bool is_before = rows.front()->preset.empty();
  const double folded = mean(rows, [](const Row& row) { return row.share_folded; });
  const double seconds = mean(rows, [](const Row& row) { return row.cpu_seconds; });
  return {number(mean(rows, [](const Row& row) { return row.errors.liver.mean; })),
          number(mean(rows, [](const Row& row) { return row.errors.liver.max; })),
          number(mean(rows, [](const Row& row) { return row.errors.outside.mean; })),
          is_before ? "-" : percentage(folded), is_before ? "-" : number(seconds, 2)};
}

StudyTable mean_table(const std::vector<Row>& rows) {
  StudyTable table;
  table.title = "Mean over the pairs";
  table.explanation =
      "Landmark errors in mm: mean and largest in the liver, mean outside of it; voxels with J <= 0; CPU seconds of a "
      "registration.";
  table.head = {"model", "preset", "liver", "liver, largest", "outside", "folds", "CPU s"};
  std::vector<std::pair<std::string, std::string>> done;
  for (const Row& first : rows) {
    const std::pair key{first.model, first.preset};
    if (std::find(done.begin(), done.end(), key) != done.end()) continue;
    done.push_back(key);
    std::vector<const Row*> alike;
    for (const Row& row : rows)
      if (row.model == first.model && row.preset == first.preset) alike.push_back(&row);
    std::vector<std::string> line{first.model, first.preset};
    for (std::string& cell : cells(alike)) line.push_back(std::move(cell));
    table.rows.push_back(std::move(line));
  }
  return table;
}

StudyTable pair_table(const std::vector<Row>& rows) {
  StudyTable table;
  table.title = "Pair by pair";
  table.explanation = "The same of each pair.";
  table.head = {"pair", "model", "preset", "liver", "liver, largest", "outside", "folds", "CPU s"};
  for (const Row& row : rows) {
    std::vector<std::string> line{row.pair, row.model, row.preset};
    for (std::string& cell : cells({&row})) line.push_back(std::move(cell));
    table.rows.push_back(std::move(line));
  }
  return table;
}

}  // namespace

int liver_study(const StudyRequest& request, bool as_json) {
  for (const std::string& model : request.models) parse_model(model);
  for (const std::string& preset : request.presets) parse_preset(preset);
  std::vector<LiverPair> livers = find_liver_pairs(request.data);
  if (livers.empty())
    throw InvalidInput("--data is '" + request.data.string() +
                       "', which has no folder liver_mri with the subjects' images and landmarks");
  if (request.is_quick) livers.resize(1);
  std::vector<Pair> pairs;
  for (const LiverPair& liver : livers)
    for (const std::string& preset : request.presets)
      for (const std::string& model : request.models) {
        Pair pair{run_name(liver, model, preset), {}};
        pair.job.fixed = liver.fixed.string();
        pair.job.moving = liver.moving.string();
        pair.job.model = model;
        pair.job.preset = preset;
        pair.job.format = "mha";
        pair.job.threads = request.threads;
        pairs.push_back(std::move(pair));
      }
  if (const int code = run_all(request, pairs); code != Done) return code;

  Study study;
  study.title = "Four breathing livers: models and presets";
  study.introduction =
      "Pairs of two subjects' 4-D liver MRI (Vishnevskiy et al., TMI 2017): the liver slides along the abdominal wall. "
      "By saltus register with similarity lncc.";
  if (request.is_quick) study.notes.push_back("Made with --quick: the first pair alone.");
  std::vector<Row> rows;
  nlohmann::json numbers{{"study", "liver"}, {"quick", request.is_quick}};
  for (const LiverPair& liver : livers) {
    rows.push_back({liver.name, "before", "", liver_errors_before(liver)});
    PairResults<3> results{liver.name, read_volume<3>(liver.fixed), read_volume<3>(liver.moving), {}, {}};
    for (const std::string& preset : request.presets)
      for (const std::string& model : request.models) {
        const auto folder = run_folder(request, run_name(liver, model, preset));
        ModelResult<3> run = read_run<3>(folder, model);
        rows.push_back({liver.name, model, preset, liver_errors(liver, run.displacement),
                        jacobian_statistics(jacobian_determinant(run.displacement)).share_not_positive,
                        cpu_seconds(folder)});
        if (preset == request.presets.back()) results.models.push_back(std::move(run));
      }
    const auto plane = liver_plane(results.models.back().displacement);
    const std::string shown = " Preset " + request.presets.back() + ", one slice of a 3-D registration.";
    study.figures.push_back({liver.name, liver.name,
                             "Deformed templates with the displacement as red arrows, and its length." + shown,
                             field_sheet(results, plane)});
    study.figures.push_back({liver.name + "_difference", liver.name + ": differences",
                             "Template minus reference before registration, deformed template minus reference after.",
                             difference_sheet(results, plane)});
  }
  for (const Row& row : rows) {
    nlohmann::json one{{"pair", row.pair},
                       {"model", row.model},
                       {"liver_mm", cli::as_json(row.errors.liver)},
                       {"outside_mm", cli::as_json(row.errors.outside)}};
    if (!row.preset.empty())
      one.update({{"preset", row.preset}, {"share_folded", row.share_folded}, {"cpu_seconds", row.cpu_seconds}});
    numbers["rows"].push_back(std::move(one));
  }
  study.tables = {mean_table(rows), pair_table(rows)};
  return finish_study(request, study, numbers, as_json);
}

}  // namespace saltus::cli
