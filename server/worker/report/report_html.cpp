#include "core/evaluation/jacobian.h"
#include "core/evaluation/statistics.h"
#include "server/worker/report/figures.h"
#include "server/worker/report/line_chart.h"
#include "server/worker/report/markup.h"
#include "server/worker/report/measures.h"
#include "server/worker/report/page_style.h"
#include "server/worker/report/report.h"

#include <algorithm>
#include <sstream>

namespace saltus::report {
namespace {

template <int Dim>
std::string describe(const ImageGrid<Dim>& grid) {
  std::ostringstream text;
  for (int axis = 0; axis < Dim; ++axis) text << (axis ? " x " : "") << grid.size[axis];
  text << " voxels of ";
  for (int axis = 0; axis < Dim; ++axis) text << (axis ? " x " : "") << number(grid.spacing[axis]);
  text << " mm";
  return text.str();
}

std::string card(const std::string& name, const std::string& value, const std::string& note) {
  return "<div class=\"card\"><div class=\"name\">" + escaped(name) + "</div><div class=\"value\">" + escaped(value) +
         "</div><div class=\"note\">" + escaped(note) + "</div></div>\n";
}

std::string from_to(double before, double after) { return number(before) + " \u2192 " + number(after); }

std::string similarity_card(const RegistrationSummary& summary, const std::string& name) {
  const double before = summary.similarity_before, after = summary.similarity_after;
  const std::string values = from_to(before, after);
  // Values are integrals and their size says little; what share of it is gone says more.
  const std::string change = before > 0 && after <= before ? percentage((before - after) / before) + " less" : values;
  return card("Dissimilarity (" + name + ")", change, values + ", at full resolution");
}

template <int Dim>
std::string cards(const ReportInput<Dim>& input, const std::optional<LandmarkMeasures>& landmarks) {
  const RegistrationSummary& summary = input.result->summary;
  std::string html = "<div class=\"cards\">\n";
  if (landmarks) {
    const Statistics before = summarise(landmarks->before), after = summarise(landmarks->after);
    html += card("Landmark error, mean", from_to(before.mean, after.mean) + " mm",
                 std::to_string(after.n) + " landmarks, median " + number(after.median) + " mm");
  }
  html += similarity_card(summary, to_string(input.options->similarity));
  const DisplacementMeasures displacement = measure_displacement(input.result->displacement);
  html += card("Displacement, largest", number(displacement.max_mm) + " mm",
               "mean " + number(displacement.mean_mm) + " mm");
  const JacobianStatistics jacobian = jacobian_statistics(input.result->jacobian);
  html +=
      card("Folded voxels (J \u2264 0)", percentage(jacobian.share_not_positive),
           "J from " + number(jacobian.min) + " to " + number(jacobian.max) + ", sd log J " + number(jacobian.sd_log));
  html +=
      card("Inverse consistency", number(summary.inverse_consistency_mm) + " mm",
           summary.hamiltonian_drift >= 0 ? "median; drift of the Hamiltonian " + percentage(summary.hamiltonian_drift)
                                          : "median over the moving image");
  const bool has_first_order = std::any_of(input.result->momenta.begin(), input.result->momenta.end(),
                                           [](const MomentumField<Dim>& field) { return field.axis >= 0; });
  if (has_first_order)
    html += card("Active first-order sites", percentage(summary.active_first_order_share),
                 "share of the sites whose momentum is not zero");
  html += card("Time", number(summary.seconds) + " s",
               number(summary.cpu_seconds) + " s of CPU, " + to_string(summary.termination));
  if (input.peak_memory_bytes > 0)
    html += card("Memory, peak", number(static_cast<double>(input.peak_memory_bytes) / (1 << 20)) + " MiB",
                 "of the worker");
  return html + "</div>\n";
}

std::string convergence_section(const RegistrationSummary& summary) {
  if (summary.history.empty()) return "";
  std::string html = "<section><h2>Convergence</h2><div class=\"charts\">\n";
  for (const LevelSummary& level : summary.levels) {
    LineChart chart;
    chart.title = "Level " + std::to_string(level.level) + ", " + level.grid + " voxels";
    chart.x_label = "iteration";
    chart.y_label = "energy";
    chart.x_is_whole = true;
    Curve energy{"energy", {}}, similarity{"similarity part", {}};
    for (const IterationRecord& record : summary.history) {
      if (record.level != level.level) continue;
      energy.points.emplace_back(record.iteration, record.energy);
      similarity.points.emplace_back(record.iteration, record.similarity);
    }
    if (energy.points.empty()) continue;
    chart.curves = {energy, similarity};
    html += to_svg(chart);
  }
  html += "</div>\n";
  std::vector<std::vector<std::string>> rows;
  for (const LevelSummary& level : summary.levels)
    rows.push_back({std::to_string(level.level), level.grid, number(level.spacing_mm), std::to_string(level.iterations),
                    std::to_string(level.evaluations), number(level.energy_before, 4), number(level.energy_after, 4),
                    to_string(level.termination), number(level.seconds), number(level.cpu_seconds)});
  html += table({"level", "grid", "spacing [mm]", "iterations", "evaluations", "energy before", "energy after", "ended",
                 "seconds", "CPU seconds"},
                rows);
  return html + "</section>\n";
}

/// Share of the landmarks (percent) that err by at most so many millimetres.
Curve distribution(const std::string& name, std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  Curve curve{name, {{errors.front(), 0}}};
  for (std::size_t i = 0; i < errors.size(); ++i)
    curve.points.emplace_back(errors[i], 100.0 * static_cast<double>(i + 1) / static_cast<double>(errors.size()));
  return curve;
}

std::string landmark_section(const LandmarkMeasures& landmarks) {
  std::vector<std::vector<std::string>> rows;
  LineChart chart{.title = "Landmarks with at most this error",
                  .x_label = "error [mm]",
                  .y_label = "share [%]",
                  .curves = {},
                  .y_starts_at_zero = true};
  const auto add = [&](const std::string& name, const std::vector<double>& errors) {
    const Statistics found = summarise(errors);
    rows.push_back({name, std::to_string(found.n), number(found.mean), number(found.sd), number(found.median),
                    number(found.p90), number(found.max)});
    chart.curves.push_back(distribution(name, errors));
  };
  add("after", landmarks.after);
  add("before", landmarks.before);
  if (landmarks.start) add("affine start", *landmarks.start);
  return "<section><h2>Landmarks</h2><p>Distance of each moving landmark from where the displacement carries its fixed "
         "one, mm.</p><div class=\"columns\">" +
         table({"", "n", "mean", "sd", "median", "90 %", "max"}, rows) + to_svg(chart) + "</div></section>\n";
}

template <int Dim>
std::string settings_section(const ReportInput<Dim>& input) {
  const RegistrationOptions& options = *input.options;
  std::vector<std::vector<std::string>> rows;
  for (const ParameterInfo& parameter : list_parameters(options))
    rows.push_back({parameter.name, parameter.value, parameter.unit, parameter.description});
  std::string html = "<section><h2>Images and settings</h2>";
  html += "<div class=\"narrow\">" +
          table({"image", "grid"},
                {{"fixed", describe(input.input->fixed.grid)}, {"moving", describe(input.input->moving.grid)}}) +
          "</div>";
  html += "<div class=\"settings\">" + table({"parameter", "value", "unit", "meaning"}, rows) + "</div>";
  return html + "</section>\n";
}

template <int Dim>
std::string timing_section(const ReportInput<Dim>& input) {
  if (input.stage_seconds.empty()) return "";
  std::vector<std::pair<std::string, double>> stages(input.stage_seconds.begin(), input.stage_seconds.end());
  std::stable_sort(stages.begin(), stages.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::vector<std::vector<std::string>> rows;
  for (const auto& [name, seconds] : stages) rows.push_back({name, number(seconds)});
  return "<section><h2>Timings</h2><div class=\"narrow\">" + table({"stage", "wall seconds"}, rows) +
         "</div></section>\n";
}

}  // namespace

template <int Dim>
std::string report_html(const ReportInput<Dim>& input) {
  const auto landmarks = measure_landmarks(input);
  const RegistrationOptions& options = *input.options;
  const std::string title = escaped(input.title.empty() ? "Registration" : input.title);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\"><title>" +
      title + "</title><style>" + page_style + "</style></head><body><main>\n<h1>" + title +
      "</h1>\n<p class=\"lead\">Model " + to_string(options.model) + ", similarity " + to_string(options.similarity) +
      ", preset " + to_string(options.preset) + "; fixed image " + describe(input.input->fixed.grid) + "</p>\n";
  for (const std::string& notice : input.result->summary.notices)
    html += "<p class=\"lead\"><strong>Notice:</strong> " + escaped(notice) + ".</p>\n";
  html += cards(input, landmarks);
  html += figure_sections(input);
  if (landmarks) html += landmark_section(*landmarks);
  html += convergence_section(input.result->summary);
  html += settings_section(input);
  html += timing_section(input);
  html +=
      "<footer>Displacements are millimetres in world coordinates (LPS): fixed(x) corresponds to moving(x + u(x)). "
      "Written by saltus.</footer>\n</main></body></html>\n";
  return html;
}

template std::string report_html(const ReportInput<2>&);
template std::string report_html(const ReportInput<3>&);

}  // namespace saltus::report
