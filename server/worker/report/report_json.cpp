#include "core/evaluation/statistics.h"
#include "core/registration/register_images.h"
#include "server/worker/report/analysis.h"
#include "server/worker/report/choices.h"
#include "server/worker/report/findings.h"
#include "server/worker/report/report.h"

#include <nlohmann/json.hpp>

#include <charconv>

namespace saltus::report {
namespace {

using Json = nlohmann::ordered_json;

template <class Eigen>
Json list(const Eigen& vector) {
  return Json(std::vector<double>(vector.data(), vector.data() + vector.size()));
}

/// Rows of a matrix, so that it reads as it is written on paper.
template <int Dim>
Json rows(const Matrix<Dim>& matrix) {
  Json all = Json::array();
  for (int row = 0; row < Dim; ++row) all.push_back(list(Vector<Dim>(matrix.row(row))));
  return all;
}

template <int Dim>
Json describe(const ImageGrid<Dim>& grid) {
  return {{"size", grid.size},
          {"spacing_mm", list(grid.spacing)},
          {"origin_mm", list(grid.origin)},
          {"direction", rows<Dim>(grid.direction)}};
}

/// Parameters come as text; numbers and booleans are told as what they are.
Json value_of(const std::string& text) {
  if (text == "true" || text == "false") return text == "true";
  const char* const last = text.data() + text.size();
  const auto is_whole = [last](const std::from_chars_result& read) {
    return read.ec == std::errc() && read.ptr == last;
  };
  int count = 0;
  if (is_whole(std::from_chars(text.data(), last, count))) return count;
  double number = 0;
  if (is_whole(std::from_chars(text.data(), last, number))) return number;
  return text;
}

Json describe(const Statistics& statistics) {
  return {{"n", statistics.n},           {"mean", statistics.mean}, {"sd", statistics.sd},
          {"median", statistics.median}, {"p90", statistics.p90},   {"max", statistics.max}};
}

template <int Dim>
Json describe(const DetectedInterface<Dim>& interface, bool may_slide) {
  Json json{{"faces", interface.faces.size()}, {"threshold_mm", interface.threshold_mm}, {"may_slide", may_slide}};
  json[Dim == 2 ? "length_mm" : "area_mm2"] = interface.extent;
  if (interface.faces.empty()) return json;
  json["slip_mm"] = describe(interface.slip_mm);
  json["gap_mm"] = describe(interface.gap_mm);
  json["strongest_voxel"] = list(*interface.strongest);
  return json;
}

template <int Dim>
Json describe(const SlipSurface<Dim>& surface, const Analysis<Dim>& analysis, const ImageGrid<Dim>& fixed) {
  const SlipSummary& slip = analysis.slip;
  Json json{{"points", surface.points.size()}, {"parts", slip.parts}};
  json[Dim == 2 ? "length_mm" : "area_mm2"] = slip.area;
  if (surface.points.empty()) return json;
  json["least_jump_mm"] = surface.least_jump_mm;
  json["jump_mm"] = {{"mean", slip.jump_mean_mm}, {"p95", slip.jump_p95_mm}, {"max", slip.jump_max_mm}};
  json["gap_p95_mm"] = slip.gap_p95_mm;
  json["overlap_p95_mm"] = slip.overlap_p95_mm;
  json["strongest_mm"] = list(fixed.to_world(*analysis.strongest_slip));
  return json;
}

Json describe(const LevelSummary& level, const RegistrationOptions::Momenta& momenta) {
  Json json = {{"level", level.level},
               {"grid", level.grid},
               {"spacing_mm", level.spacing_mm},
               {"iterations", level.iterations},
               {"evaluations", level.evaluations},
               {"rounds", level.rounds},
               {"smoothing_voxels", level.smoothing_voxels},
               {"similarity_weight", level.similarity_weight},
               {"map_steps", level.map_steps},
               {"optimality", level.optimality},
               {"energy_before", level.energy_before},
               {"energy_after", level.energy_after},
               {"termination", to_string(level.termination)},
               {"seconds", level.seconds},
               {"active_block_share", level.active_block_share},
               {"cpu_seconds", level.cpu_seconds}};
  if (level.decision != FirstOrderDecision::None) {
    const bool is_in = level.decision == FirstOrderDecision::LetIn;
    json["first_order_momenta"] = {{"let_in", is_in},
                                   {"simple_shear", level.simple_shear},
                                   {"was_plain", level.was_plain},
                                   {"finer_order_0", level.has_finer}};
    if (is_in) {
      auto& found = json["first_order_momenta"];
      found["is_plain"] = is_plain(momenta, level);
      found["regularisation_beside"] = regularisation_beside(momenta, level);
      if (level.quick_share >= 0) found["quick_share"] = level.quick_share;
      if (level.quick_after >= 0) found["quick_after"] = level.quick_after;
      if (level.quick_share >= 0 || level.quick_after >= 0) found["order_0_gave_up_sharp"] = level.gave_up_sharp;
    }
  }
  if (level.kept_out_share > 0) json["kept_out_block_share"] = level.kept_out_share;
  if (level.shear_before >= 0)
    json["narrow_widths"] = {{"share", level.narrow_share}, {"simple_shear_before", level.shear_before}};
  if (level.narrow_pull >= 0)
    json["narrower_order_0"] = {
        {"added", level.has_narrower}, {"pull_over_noise", level.narrow_pull}, {"at_finest_scale", level.own_pull}};
  else if (level.decision == FirstOrderDecision::None && level.simple_shear > 0)
    json["narrower_order_0"] = {{"added", false}, {"simple_shear", level.simple_shear}};
  if (level.map_error_mm > 0) json["map_error_mm"] = level.map_error_mm;
  if (level.oblique_share > 0 || level.oriented_elements > 0)
    json["oriented_momenta"] = {{"elements", level.oriented_elements}, {"oblique_share", level.oblique_share}};
  return json;
}

Json describe(const IterationRecord& record) {
  return {{"level", record.level},           {"round", record.round},
          {"iteration", record.iteration},   {"energy", record.energy},
          {"similarity", record.similarity}, {"regularisation", record.regularisation},
          {"sparsity", record.sparsity},     {"step", record.step},
          {"optimality", record.optimality}};
}

template <int Dim>
Json describe(const MomentumField<Dim>& field) {
  Json json{{"order", field.axis == MomentumField<Dim>::kZeroth ? 0 : 1}};
  if (field.axis >= 0) json["axis"] = field.axis;
  if (field.axis == MomentumField<Dim>::kOriented) json["axis"] = "oriented";
  json["kernel"] = field.kernel;
  json["width_mm"] = field.width_mm;
  if (field.axis == MomentumField<Dim>::kOriented) json["normal_width_mm"] = field.normal_width_mm;
  json["size"] = field.vectors.grid.size;
  json["spacing_mm"] = list(field.vectors.grid.spacing);
  json["active_share"] = active_share(field.vectors);
  return json;
}

}  // namespace

template <int Dim>
std::string report_json(const ReportInput<Dim>& input, const Analysis<Dim>& analysis) {
  const RegistrationOptions& options = *input.options;
  const RegistrationResult<Dim>& result = *input.result;
  const RegistrationSummary& summary = result.summary;

  Json json;
  json["title"] = input.title;
  if (!input.program.empty()) json["program"] = input.program;
  json["command"] = command_line(input);
  if (!input.digests.empty()) json["digests"] = input.digests;
  json["dimension"] = Dim;
  json["model"] = to_string(options.model);
  json["similarity"] = to_string(options.similarity);
  json["preset"] = to_string(options.preset);
  for (const ParameterInfo& parameter : list_parameters(options))
    json["parameters"][parameter.name] = value_of(parameter.value);
  json["threads"] = options.threads;
  json["fixed"] = describe(input.input->fixed.grid);
  json["moving"] = describe(input.input->moving.grid);
  json["affine_start"] = {{"linear", rows<Dim>(input.input->start.linear)},
                          {"offset_mm", list(input.input->start.offset)}};

  json["termination"] = to_string(summary.termination);
  json["notices"] = summary.notices;
  json["noise"] = summary.noise;
  if (!summary.region.empty()) json["region"] = summary.region;
  json["similarity_value"] = {{"before", summary.similarity_before}, {"after", summary.similarity_after}};
  if (const auto& landmarks = analysis.landmarks) {
    json["landmark_error_mm"]["before"] = describe(summarise(landmarks->before));
    if (landmarks->start) json["landmark_error_mm"]["affine_start"] = describe(summarise(*landmarks->start));
    json["landmark_error_mm"]["after"] = describe(summarise(landmarks->after));
    if (!landmarks->particles.empty())
      json["landmark_error_mm"]["after_particles"] = describe(summarise(landmarks->particles));
    json["landmark_particles_stopped"] = landmarks->particles_stopped;
  }
  const DisplacementMeasures& displacement = analysis.displacement;
  json["displacement_mm"] = {{"mean", displacement.mean_mm}, {"max", displacement.max_mm}};
  const JacobianStatistics& jacobian = analysis.jacobian;
  json["jacobian"] = {{"min", jacobian.min},
                      {"max", jacobian.max},
                      {"share_not_positive", jacobian.share_not_positive},
                      {"sd_log", jacobian.sd_log}};
  json["folded_voxels"] = {{"n", analysis.folded.n}, {"off_interface", analysis.folded.off_interface}};
  json["interface"] = describe(analysis.interface, analysis.may_slide);
  json["slip_surface"] = describe(result.slip, analysis, input.input->fixed.grid);
  json["share_beyond_moving"] = analysis.share_beyond_moving;
  json["findings"] = Json::array();
  for (const Finding& finding : findings(input, analysis))
    json["findings"].push_back({{"verdict", to_string(finding.verdict)}, {"text", finding.text}});
  json["chosen"] = Json::array();
  for (const Choice& choice : choices(input))
    json["chosen"].push_back({{"name", choice.name}, {"value", value_of(choice.value)}, {"why", choice.why}});
  json["inverse_consistency_mm"] = summary.inverse_consistency_mm;
  if (summary.hamiltonian_drift >= 0) json["hamiltonian_drift"] = summary.hamiltonian_drift;
  json["active_first_order_share"] = summary.active_first_order_share;
  json["seconds"] = {{"wall", summary.seconds}, {"cpu", summary.cpu_seconds}};
  json["stage_seconds"] = input.stage_seconds;
  if (input.peak_memory_bytes > 0) json["peak_memory_bytes"] = input.peak_memory_bytes;
  json["memory_estimate_bytes"] = memory_estimate(input.input->fixed.grid, input.input->moving.grid, *input.options);

  json["momenta"] = json["levels"] = json["history"] = Json::array();
  for (const MomentumField<Dim>& field : result.momenta) json["momenta"].push_back(describe(field));
  for (const LevelSummary& level : summary.levels)
    json["levels"].push_back(describe(level, input.result->options.momenta));
  for (const IterationRecord& record : summary.history) json["history"].push_back(describe(record));
  // A title may hold any bytes; what is no UTF-8 must not cost the report.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

template std::string report_json(const ReportInput<2>&, const Analysis<2>&);
template std::string report_json(const ReportInput<3>&, const Analysis<3>&);

}  // namespace saltus::report
