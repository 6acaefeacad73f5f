#include "server/worker/report/choices.h"

#include "core/drawing/markup.h"

#include <map>

namespace saltus::report {

using namespace drawing;

namespace {

std::map<std::string, std::string> values_of(const RegistrationOptions& options) {
  std::map<std::string, std::string> values;
  for (const ParameterInfo& parameter : list_parameters(options)) values[parameter.name] = parameter.value;
  return values;
}

RegistrationOptions defaults_of(const RegistrationOptions& options) {
  return default_options(options.model, options.similarity, options.preset);
}

/// Which kinds of scales have a kernel of width_voxels, not a sum of widths. A kind that is not there counts as the
/// other.
struct ScalesOfOneWidth {
  bool with_zeroth = false, of_first_alone = false;
};

ScalesOfOneWidth scales_of_one_width(const RegistrationOptions& resolved) {
  const RegistrationOptions::Momenta& momenta = resolved.momenta;
  const bool zeroth = momenta.kernel_widths.empty();
  return {zeroth, may_have_first_order_alone(resolved) ? momenta.first_order_kernel_widths.empty() : zeroth};
}

std::string where_sparsity_is_from(const RegistrationOptions& asked) {
  const bool is_chosen = asked.momenta.sparsity < 0;
  std::string from;
  const auto add = [&](const std::string& cause) { from += (from.empty() ? "from " : "; ") + cause; };
  if (is_chosen) add("the model, the similarity, the preset and the dimension");
  if (asked.momenta.sparsity_noise > 0) add("the noise on the finest level (sparsity_noise)");
  if (asked.momenta.full_contrast > 0 && asked.similarity == SimilarityType::Ssd)
    add(is_chosen ? "the fixed image's contrast, where that is low (full_contrast), and the noise"
                  : "the fixed image's contrast, which is low (full_contrast), and the noise");
  return from;
}

template <int Dim>
std::string measured_from(const std::string& name, const ReportInput<Dim>& input) {
  const ImageGrid<Dim>& grid = input.input->fixed.grid;
  if (name == "levels")
    return "from the size of the fixed image (" + size_text<Dim>(grid.size) +
           "): halved until its longest axis has fewer than 32 samples";
  if (name == "finest_level")
    return Dim == 2
               ? "2-D images are registered at full resolution"
               : "from the preset " + to_string(input.options->preset) +
                     " for 3-D images (fast at most 2 with voxels of 4 mm, balanced at most 1 with 3 mm, accurate 0)";
  if (name == "orientations") return "8 in 2-D and 9 in 3-D, where there are first orders that are sparse and carried";
  if (name == "width_voxels") {
    const auto [zeroth, first] = scales_of_one_width(input.result->options);
    return std::string(zeroth && first ? "of all scales"
                       : zeroth        ? "of the scales with order 0"
                                       : "of the scales of order 1 alone") +
           ", from the model and the similarity";
  }
  if (name == "most_active_share") return "from the model and the dimension; it bounds the memory that a job declares";
  if (name == "kernel_widths") return "from the model, the similarity and the noise on the finest level";
  if (name == "finer_shear")
    return "that of first_order_shear where order 0 ends at a coarser scale than the images, or 0: from the "
           "similarity, the dimension, the preset and the size of the voxels";
  if (name == "regularisation" || name == "oblique_share" || name == "oriented_sparsity" || name == "divergence_weight")
    return "from the similarity and the dimension, for which it was measured";
  if (name == "first_order_shear" || name == "settled_plain_shear") {
    const RegistrationOptions::Momenta& asked = input.options->momenta;
    const bool is_one_weight = asked.regularisation_beside_first > 0 && asked.regularisation_beside_plain == 0;
    return std::string("from the similarity, the dimension and the preset, for which it was measured") +
           (is_one_weight ? ", with one weight beside all slips (regularisation_beside_first)" : "");
  }
  if (name == "quick_share")
    return "from the model, the similarity, the preset and the dimension, where oriented momenta are alone and wait "
           "for order 0, for which it was measured";
  if (name == "quick_tolerance")
    return "from the model, the preset, the dimension and tolerance, where oriented momenta are alone and wait for "
           "order 0, for which it was measured";
  if (name == "plain_shear")
    return "by first_order_shear, where order 0 need not settle first: from the similarity, the dimension, the preset "
           "and its weight beside first orders";
  if (name == "first_round_tolerance" || name == "tolerance")
    return "from the fixed image's contrast and noise (full_contrast)";
  if (name == "round_tolerance")
    return input.options->momenta.full_contrast > 0 && input.options->optimisation.round_tolerance >= 0
               ? "from the fixed image's contrast and noise (full_contrast)"
               : "from the model, the similarity, the preset and the dimension";
  if (name == "history") return "from the dimension, the similarity and the model";
  if (name == "narrower_pull") {
    const RegistrationOptions& asked = *input.options;
    if (input.result->options.momenta.first_order_shear == 0)
      return "order 0 is never alone for good where first_order_shear is 0";
    if (!asked.momenta.kernel_widths.empty() || asked.momenta.width_voxels > 0 || asked.flow.coarsening != 1)
      return "from the widths or the coarsening that were given, which count as they are";
    return Dim == 2 ? "it was not measured for 2-D images" : "from the similarity, for which it was measured";
  }
  if (name == "narrow_width_shear") {
    const RegistrationOptions::Momenta& asked = input.options->momenta;
    return asked.kernel_widths.empty() && asked.width_voxels == 0
               ? "from the similarity and the dimension, for which it was measured"
               : "from the widths that were given, which count as they are";
  }
  if (name == "regularisation_beside_first")
    return input.options->similarity == SimilarityType::Ssd
               ? "from the fixed image's contrast, which is low (full_contrast), and the noise"
               : "from regularisation, by model, similarity, preset and dimension: how much of what is "
                 "sharp is left to first orders";
  if (name == "regularisation_beside_plain")
    return "from regularisation, by model, similarity, preset and dimension: where a slip was plain (plain_shear, "
           "settled_plain_shear) it is all that is sharp";
  if (name == "oriented_alone" || name == "oriented_width")
    return "from the similarity and the dimension, with ssd from the fixed image's contrast (full_contrast)";
  if (name == "lost_noise") return "from the similarity, and whether the images are finer than with balanced";
  if (name == "shear_weights")
    return "from the similarity and the dimension, where oriented momenta are alone and wait for order 0, "
           "reweighted rounds follow and the path of weights is the usual one";
  if (name == "sparsity") return where_sparsity_is_from(*input.options);
  return "from the levels";
}

/// What order 0 weighs from then on, where that is another weight than before or depends on how plain the slip was.
std::string beside(const RegistrationOptions::Momenta& momenta, const LevelSummary& level) {
  const double weight = regularisation_beside(momenta, level);
  const bool is_told = momenta.regularisation_beside_plain > 0;
  if (weight == momenta.regularisation && !is_told) return "";
  const std::string plain = !is_told                   ? ""
                            : is_plain(momenta, level) ? " (the slip is plain)"
                                                       : " (the slip is not plain)";
  return "; regularisation is " + number(weight) + " beside them" + plain;
}

/// What order 0 began with from then on, where it was asked how quick it had been.
std::string start_beside(const RegistrationOptions::Momenta& momenta, const LevelSummary& level) {
  const std::string then =
      level.gave_up_sharp ? "it gave up what was sharp, which it finds again as fast" : "it kept what it had found";
  if (level.quick_after >= 0)
    return "; the last five iterations had at most " + percentage(momenta.quick_tolerance) +
           " of what order 0 had brought: " + then;
  if (momenta.quick_share == 0 || level.quick_share < 0) return "";
  return "; ten iterations had " + percentage(level.quick_share) +
         " of what order 0 brought until it settled (asked: " + percentage(momenta.quick_share) + "): " + then;
}

}  // namespace

template <int Dim>
std::vector<Choice> choices(const ReportInput<Dim>& input) {
  const auto defaults = values_of(defaults_of(*input.options)), used = values_of(input.result->options);
  const auto [with_zeroth, of_first_alone] = scales_of_one_width(input.result->options);
  const bool has_one_width = with_zeroth || of_first_alone;
  std::vector<Choice> found;
  for (const ParameterInfo& asked : list_parameters(*input.options)) {
    const auto in_use = used.find(asked.name), by_default = defaults.find(asked.name);
    const bool is_set = by_default != defaults.end() && by_default->second != asked.value;
    const bool is_filled_in = in_use != used.end() && in_use->second != asked.value &&
                              asked.name != "sparsity_noise" &&  // used up: what follows them says so
                              asked.name != "full_contrast";
    if (asked.name == "width_voxels" && !is_set && !has_one_width) continue;
    const bool is_of_oriented =
        asked.name == "oblique_share" || asked.name == "shear_weights" || asked.name.starts_with("oriented_");
    if (is_of_oriented && !is_set && input.result->options.momenta.orientations == 0) continue;
    const bool smoothing_is_given = input.options->similarity_parameters.smoothing_voxels >= 0;
    if (asked.name == "lost_noise" && !is_set && smoothing_is_given) continue;
    if (is_set)
      found.push_back(
          {asked.name, asked.value, asked.unit, "set by the job; the default is " + by_default->second, true});
    if (is_set && is_filled_in)
      found.push_back({asked.name + " in use", in_use->second, asked.unit, measured_from(asked.name, input), false});
    else if (!is_set && is_filled_in)
      found.push_back({asked.name, in_use->second, asked.unit, measured_from(asked.name, input), false});
  }
  const RegistrationSummary& summary = input.result->summary;
  if (summary.noise > 0 && input.options->similarity_parameters.noise < 0)
    found.push_back({"noise", percentage(summary.noise), "",
                     std::string("measured in the images, of ") +
                         (input.options->similarity == SimilarityType::Ssd ? "the fixed image's" : "each one's own") +
                         " range",
                     false});
  if (!summary.region.empty()) {
    std::string box;
    for (const auto& [begin, end] : summary.region)
      box += (box.empty() ? "" : ", ") + std::to_string(begin) + " to " + std::to_string(end - 1);
    found.push_back(
        {"region", box, "voxels",
         "along the axes of the fixed image, from 0: in this box and " +
             values_of(input.result->options).at("region_margin") +
             " voxels of the level around it the images are compared; beyond it both are hidden by masks or no "
             "more than background and noise",
         false});
  }
  for (const LevelSummary& level : summary.levels) {
    const std::string where = "level " + std::to_string(level.level) + ": ";
    if (level.smoothing_voxels > 0)
      found.push_back({where + "smoothing", number(level.smoothing_voxels), "voxels",
                       "of both images, as their noise at this level needs", false});
    if (level.similarity_weight != 1)
      found.push_back({where + "weight of the similarity", number(level.similarity_weight), "",
                       "as the noise at this level allows", false});
  }
  const RegistrationOptions::Flow& flow = input.result->options.flow;
  const auto is_finest = [&](const LevelSummary& level) { return &level == &summary.levels.back(); };
  for (const LevelSummary& level : summary.levels) {
    if (flow.map_tolerance == 0) continue;
    std::string why = level.level == 1 ? "nothing was known of the motion" : "by the motion found before";
    if (is_finest(level) && level.map_steps == flow.map_steps) why += "; on the finest level at least map_steps";
    if (level.has_narrower) why += "; up to twice as many with the narrower scale of order 0";
    if (level.map_steps == kMostMapSteps) why += "; at most " + std::to_string(kMostMapSteps);
    why += "; at the end 99.9 % of the sites are followed to within " + number(level.map_error_mm / level.spacing_mm) +
           " voxels (asked: " + number(flow.map_tolerance) + ")";
    found.push_back({"level " + std::to_string(level.level) + ": steps of the map", std::to_string(level.map_steps), "",
                     why, false});
  }
  for (const LevelSummary& level : summary.levels) {
    if (level.shear_before < 0) continue;
    const bool is_sharp = level.narrow_share == 1;
    found.push_back({"level " + std::to_string(level.level) + ": narrow widths of order 0, alone",
                     is_sharp ? "as in kernel_widths" : "count " + number(level.narrow_share) + " of that", "",
                     "the level before ended with a simple shear of " + number(level.shear_before) +
                         " (asked: " + number(input.result->options.momenta.narrow_width_shear) +
                         "): " + (is_sharp ? "something is sharp" : "the motion is smooth"),
                     false});
  }
  for (const LevelSummary& level : summary.levels) {
    if (level.decision == FirstOrderDecision::None) continue;
    const RegistrationOptions::Momenta& asked = input.result->options.momenta;
    const bool is_in = level.decision == FirstOrderDecision::LetIn;
    const double least = level.was_plain   ? asked.plain_shear
                         : level.has_finer ? asked.finer_shear
                                           : asked.first_order_shear;
    const bool shows = level.simple_shear >= least;
    found.push_back(
        {"level " + std::to_string(level.level) + ": first-order momenta", is_in ? "let in" : "left out", "",
         (level.was_plain          ? "before order 0 had settled"
          : level.quick_after >= 0 ? "with order 0 quick, after " + std::to_string(level.quick_after) + " iterations,"
          : level.has_finer        ? "with order 0 settled on finer scales of its own"
                                   : std::string("with order 0 settled")) +
             " the simple shear of its displacement, as it is or less what most of the image does, was " +
             number(level.simple_shear) + " (asked: " + number(least) + "): " +
             (is_in   ? "something slides" + beside(asked, level) + start_beside(asked, level)
              : shows ? "something slides, but none of them wanted to join"
                      : "nothing slides so much that they are worth their time"),
         false});
  }
  for (const LevelSummary& level : summary.levels) {
    const std::string name = "level " + std::to_string(level.level) + ": a narrower scale of order 0, alone";
    if (level.narrow_pull < 0) {
      if (level.decision == FirstOrderDecision::None && level.simple_shear > 0)
        found.push_back({name, "not asked", "",
                         "with order 0 at rest, the simple shear of its displacement, as it is or less what most of "
                         "the image does, was " +
                             number(level.simple_shear) + " (asked: less than " +
                             number(input.result->options.momenta.first_order_shear) +
                             "): something slides, which first orders on finer levels are for",
                         false});
      continue;
    }
    const double asked = input.result->options.momenta.narrower_pull;
    found.push_back({name, level.has_narrower ? "added" : "left out", "",
                     "with order 0 at rest, the square of what pulled at it was " + number(level.narrow_pull) +
                         " times what noise makes of it (asked: " + number(asked) + "), and " + number(level.own_pull) +
                         " times at its finest scale: " +
                         (level.has_narrower          ? "there is detail that wider kernels do not follow"
                          : level.narrow_pull < asked ? "too little detail stands out from noise"
                                                      : "it is not the width that holds order 0 back"),
                     false});
  }
  for (const LevelSummary& level : summary.levels) {
    const RegistrationOptions::Momenta& asked = input.result->options.momenta;
    const bool has_any = level.oblique_share > 0 || level.oriented_elements > 0;
    if (!has_any || input.options->momenta.oblique_share == 0) continue;
    found.push_back({"level " + std::to_string(level.level) + ": oriented momenta",
                     level.oriented_elements > 0 ? std::to_string(level.oriented_elements) : "left out", "",
                     asked.oblique_share == 0 && level.oriented_elements == 0
                         ? "none of them wanted to join"
                         : percentage(level.oblique_share) + " of what may slide is oblique to the axes" +
                               (asked.oblique_share > 0 ? " (asked: " + percentage(asked.oblique_share) + ")" : ""),
                     false});
  }
  return found;
}

template <int Dim>
std::string command_line(const ReportInput<Dim>& input) {
  const RegistrationOptions& options = *input.options;
  std::string line = "saltus register --fixed FIXED --moving MOVING --out DIR --model " + to_string(options.model) +
                     " --similarity " + to_string(options.similarity) + " --preset " + to_string(options.preset);
  for (const auto& [name, value] : input.job_options) line += " --" + name + ' ' + value;
  for (const Choice& choice : choices(input))
    if (choice.is_set) line += " --set " + choice.name + '=' + choice.value;
  return line;
}

template std::vector<Choice> choices(const ReportInput<2>&);
template std::vector<Choice> choices(const ReportInput<3>&);
template std::string command_line(const ReportInput<2>&);
template std::string command_line(const ReportInput<3>&);

}  // namespace saltus::report
