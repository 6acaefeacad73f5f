#include "core/drawing/line_chart.h"
#include "core/drawing/markup.h"
#include "core/drawing/page_style.h"
#include "core/evaluation/statistics.h"
#include "server/worker/report/analysis.h"
#include "server/worker/report/choices.h"
#include "server/worker/report/figures.h"
#include "server/worker/report/findings.h"
#include "server/worker/report/report.h"
#include "server/worker/report/viewer.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>

namespace saltus::report {

using namespace drawing;

namespace {

template <int Dim>
std::string grid_text(const ImageGrid<Dim>& grid) {
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
std::string cards(const ReportInput<Dim>& input, const Analysis<Dim>& analysis) {
  const RegistrationSummary& summary = input.result->summary;
  std::string html = "<div class=\"cards\">\n";
  if (analysis.landmarks) {
    const Statistics before = summarise(analysis.landmarks->before), after = summarise(analysis.landmarks->after);
    html += card("Landmark error, mean", from_to(before.mean, after.mean) + " mm",
                 std::to_string(after.n) + " landmarks, median " + number(after.median) + " mm");
  }
  html += similarity_card(summary, to_string(input.options->similarity));
  const DisplacementMeasures& displacement = analysis.displacement;
  html += card("Displacement, largest", number(displacement.max_mm) + " mm",
               "mean " + number(displacement.mean_mm) + " mm");
  if (analysis.may_slide && analysis.slip.area > 0)
    html += card("Slip across the interface", number(analysis.slip.jump_mean_mm) + " mm",
                 "mean; 95 % below " + number(analysis.slip.jump_p95_mm) + " mm, largest " +
                     number(analysis.slip.jump_max_mm) + " mm");
  if (const DetectedInterface<Dim>& interface = analysis.interface; !analysis.may_slide && !interface.faces.empty())
    html += card("Steepest change, smooth", number(interface.slip_mm.median) + " mm",
                 "median; 90 % below " + number(interface.slip_mm.p90) + " mm, largest " +
                     number(interface.slip_mm.max) + " mm");
  const JacobianStatistics& jacobian = analysis.jacobian;
  html +=
      card("Folded voxels (J \u2264 0)", percentage(jacobian.share_not_positive),
           "J from " + number(jacobian.min) + " to " + number(jacobian.max) + ", sd log J " + number(jacobian.sd_log));
  html +=
      card("Inverse consistency",
           (summary.inverse_consistency_mm < 0.001 ? "< 0.001" : number(summary.inverse_consistency_mm)) + " mm",
           summary.hamiltonian_drift >= 0 ? "median; drift of the Hamiltonian " + percentage(summary.hamiltonian_drift)
                                          : "median over the moving image");
  const int oriented = summary.levels.empty() ? 0 : summary.levels.back().oriented_elements;
  if (analysis.may_slide && summary.active_first_order_share > 0)
    html += card("Active first-order sites", percentage(summary.active_first_order_share),
                 "share of the sites whose momentum along an axis is not zero" +
                     (oriented > 0 ? ", beside " + std::to_string(oriented) + " oriented momenta" : ""));
  else if (analysis.may_slide)
    html += card("Oriented momenta", std::to_string(oriented), "turned to the interface; none along the axes");
  html += card("Time", number(summary.seconds) + " s",
               number(summary.cpu_seconds) + " s of CPU, " + to_string(summary.termination));
  if (input.peak_memory_bytes > 0)
    html += card("Memory, peak", number(static_cast<double>(input.peak_memory_bytes) / (1 << 20)) + " MiB",
                 "of the worker");
  return html + "</div>\n";
}

/// Blocks of momenta along the axes, and oriented momenta.
std::string active_momenta(const LevelSummary& level) {
  const std::string blocks = percentage(level.active_block_share);
  if (level.oriented_elements == 0) return blocks + " of the blocks";
  return blocks + " of the blocks, " + std::to_string(level.oriented_elements) + " oriented";
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
                    number(level.optimality, 2), number(level.smoothing_voxels, 2), number(level.similarity_weight),
                    active_momenta(level), to_string(level.termination), number(level.seconds),
                    number(level.cpu_seconds)});
  html +=
      table({"level", "grid", "spacing [mm]", "iterations", "evaluations", "energy before", "energy after",
             "gradient left", "smoothing [voxels]", "weight", "active first orders", "ended", "seconds", "CPU seconds"},
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

/// The landmarks that are farthest off, so that one can go and look at them.
template <int Dim>
std::string worst_landmarks(const ReportInput<Dim>& input, const LandmarkMeasures& landmarks) {
  constexpr std::size_t most = 10;
  std::vector<std::size_t> order(landmarks.after.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return landmarks.after[a] > landmarks.after[b]; });
  order.resize(std::min(most, order.size()));
  std::vector<std::vector<std::string>> rows;
  const ImageGrid<Dim>& grid = input.input->fixed.grid;
  for (std::size_t i : order) {
    std::string world, voxel;
    const Vector<Dim>& point = input.fixed_points[i];
    const Vector<Dim> index = grid.to_index(point);
    for (int axis = 0; axis < Dim; ++axis) {
      world += (axis ? ", " : "") + number(point[axis], 4);
      voxel += (axis ? ", " : "") + std::to_string(std::lround(index[axis]));
    }
    rows.push_back({std::to_string(i + 1), world, voxel, number(landmarks.before[i]), number(landmarks.after[i])});
  }
  return "<h3>Farthest off</h3>" + table({"row", "fixed point, mm (LPS)", "voxel", "before [mm]", "after [mm]"}, rows);
}

template <int Dim>
std::string landmark_section(const ReportInput<Dim>& input, const LandmarkMeasures& landmarks) {
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
         table({"", "n", "mean", "sd", "median", "90 %", "max"}, rows) + to_svg(chart) + "</div>" +
         worst_landmarks(input, landmarks) + "</section>\n";
}

std::string findings_section(const std::vector<Finding>& all) {
  std::string html = "<ul class=\"findings\">\n";
  for (const Finding& finding : all)
    html += "<li class=\"" + to_string(finding.verdict) + "\">" + escaped(finding.text) + "</li>\n";
  return html + "</ul>\n";
}

template <int Dim>
std::string inputs_section(const ReportInput<Dim>& input) {
  const auto row = [&](const std::string& name, const ImageGrid<Dim>& grid) {
    std::string origin, direction;
    for (int i = 0; i < Dim; ++i) {
      origin += (i ? ", " : "") + number(grid.origin[i], 5);
      for (int j = 0; j < Dim; ++j) direction += (j ? " " : i ? "; " : "") + number(grid.direction(i, j), 3);
    }
    const auto digest = input.digests.find(name);
    return std::vector<std::string>{name, grid_text(grid), origin, direction,
                                    digest == input.digests.end() ? "" : digest->second};
  };
  std::vector<std::vector<std::string>> rows{row("fixed", input.input->fixed.grid),
                                             row("moving", input.input->moving.grid)};
  for (const auto& [role, digest] : input.digests)
    if (role != "fixed" && role != "moving") rows.push_back({role, "", "", "", digest});
  return "<section><h2>Inputs</h2><div class=\"inputs\">" +
         table({"file", "grid", "origin [mm, LPS]", "direction (rows)", "content"}, rows) + "</div></section>\n";
}

template <int Dim>
std::string settings_section(const ReportInput<Dim>& input) {
  std::vector<std::vector<std::string>> chosen, all;
  for (const Choice& choice : choices(input)) chosen.push_back({choice.name, choice.value, choice.unit, choice.why});
  std::string html = "<section><h2>What was chosen, and why</h2><p>Model " + to_string(input.options->model) +
                     ", similarity " + to_string(input.options->similarity) + ", preset " +
                     to_string(input.options->preset) +
                     ". Everything else is the default of these three, but for what follows.</p>";
  if (!chosen.empty())
    html += "<div class=\"settings\">" + table({"parameter", "value", "unit", "why"}, chosen) + "</div>";
  for (const ParameterInfo& parameter : list_parameters(*input.options))
    all.push_back({parameter.name, parameter.value, parameter.unit, parameter.description});
  html += "<details><summary>All expert parameters, as the job gave them</summary><div class=\"settings\">" +
          table({"parameter", "value", "unit", "meaning"}, all) + "</div></details>";
  html += "<h3>To make this result again</h3><p>From the same files, with any number of threads" +
          (input.program.empty() ? "" : ", by " + escaped(input.program)) + ":</p><pre>" +
          escaped(command_line(input)) + "</pre>";
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
std::string report_html(const ReportInput<Dim>& input, const Analysis<Dim>& analysis) {
  const RegistrationOptions& options = *input.options;
  const std::string title = escaped(input.title.empty() ? "Registration" : input.title);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"" +
      content_policy() + "\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>" + title +
      "</title><style>" + page_style + "</style></head><body><main>\n<h1>" + title + "</h1>\n<p class=\"lead\">Model " +
      to_string(options.model) + ", similarity " + to_string(options.similarity) + ", preset " +
      to_string(options.preset) + "; fixed image " + grid_text(input.input->fixed.grid) + "</p>\n";
  html += cards(input, analysis);
  html += findings_section(findings(input, analysis));
  html += figure_sections(input, analysis);
  if (analysis.landmarks) html += landmark_section(input, *analysis.landmarks);
  html += convergence_section(input.result->summary);
  html += inputs_section(input);
  html += settings_section(input);
  html += timing_section(input);
  html +=
      "<footer>Displacements are millimetres in world coordinates (LPS): fixed(x) corresponds to moving(x + u(x)). "
      "Written by " +
      escaped(input.program.empty() ? "saltus" : input.program) + ".</footer>\n</main></body></html>\n";
  return html;
}

template std::string report_html(const ReportInput<2>&, const Analysis<2>&);
template std::string report_html(const ReportInput<3>&, const Analysis<3>&);

}  // namespace saltus::report
