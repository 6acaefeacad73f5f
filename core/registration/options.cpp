#include "core/registration/options.h"

#include "core/registration/names.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

const Names<Model> kModels = {{Model::Gaussian, "gaussian"},   {Model::Wendland, "wendland"},
                              {Model::Wendland1, "wendland1"}, {Model::Directional, "directional"},
                              {Model::Sliding, "sliding"},     {Model::Auto, "auto"}};
const Names<SimilarityType> kSimilarities = {{SimilarityType::Ssd, "ssd"},   {SimilarityType::Ncc, "ncc"},
                                             {SimilarityType::Lncc, "lncc"}, {SimilarityType::Mi, "mi"},
                                             {SimilarityType::Ngf, "ngf"},   {SimilarityType::Mind, "mind"}};
const Names<Preset> kPresets = {{Preset::Fast, "fast"}, {Preset::Balanced, "balanced"}, {Preset::Accurate, "accurate"}};

}  // namespace

std::vector<Model> all_models() { return values_of(kModels); }
std::vector<SimilarityType> all_similarities() { return values_of(kSimilarities); }
std::vector<Preset> all_presets() { return values_of(kPresets); }

std::string to_string(Model model) { return name_of(kModels, model); }
std::string to_string(SimilarityType similarity) { return name_of(kSimilarities, similarity); }
std::string to_string(Preset preset) { return name_of(kPresets, preset); }

Model parse_model(std::string_view text) { return value_of(kModels, "model", text); }
SimilarityType parse_similarity(std::string_view text) { return value_of(kSimilarities, "similarity", text); }
Preset parse_preset(std::string_view text) { return value_of(kPresets, "preset", text); }

bool is_zeroth_gaussian(Model model) {
  return model == Model::Gaussian || model == Model::Sliding || model == Model::Auto;
}

bool may_have_first_order_alone(const RegistrationOptions& options) {
  const RegistrationOptions::Momenta& m = options.momenta;
  if (m.first_order_scales == 0) return false;
  if (is_zeroth_gaussian(options.model) || m.first_order_finest_scale < m.finest_scale) return true;
  // Order 1 goes no coarser than order 0 unless it begins there.
  const bool is_known = m.finest_scale >= 0 && m.first_order_finest_scale >= 0 && m.scales > 0;
  return is_known ? m.first_order_finest_scale >= m.finest_scale + m.scales
                  : m.first_order_finest_scale != m.finest_scale;
}

RegistrationOptions default_options(Model model, SimilarityType similarity, Preset preset) {
  RegistrationOptions o;
  o.model = model;
  o.similarity = similarity;
  o.preset = preset;
  switch (model) {
    case Model::Gaussian:
    case Model::Wendland:
      o.momenta.first_order_scales = 0;
      break;
    case Model::Wendland1:
    case Model::Directional:
      o.momenta.first_order_scales = 8;  // beside every order-0 scale
      break;
    case Model::Auto:
      o.momenta.first_order_shear = o.momenta.plain_shear = o.momenta.settled_plain_shear = -1;
      o.momenta.quick_share = o.momenta.quick_tolerance = -1;
      o.momenta.most_active_share = 0;
      [[fallthrough]];
    case Model::Sliding:
      o.momenta.first_order_scales = 1;
      if (similarity == SimilarityType::Ssd) {
        // ssd follows noise: order 0 leaves the finest scale to order 1, which is sparse.
        o.momenta.first_order_scales = 2;
        o.momenta.finest_scale = -2;
        if (model == Model::Auto) o.momenta.finer_shear = -1;
      }
      if (model == Model::Auto) {
        o.momenta.orientations = -1;
        o.momenta.oblique_share = -1;
        o.momenta.oriented_alone = -1;
        o.momenta.shear_weights = -1;
      }
      break;
  }
  const bool is_sliding = model == Model::Sliding || model == Model::Auto;
  // A Gaussian six samples wide needs every second one only (core/measurements.md, "Lattices").
  if (is_zeroth_gaussian(model)) o.flow.coarsening = 1;
  // The energy density is a squared intensity difference for ssd and about 1 for lncc. With d of the fixed image's
  // range for standard deviation, 1 - c of ncc is about ssd / (2 d^2): ten times ssd.
  switch (similarity) {
    case SimilarityType::Ssd:
      o.momenta.regularisation = 0;
      o.momenta.first_order_regularisation = 1e-6;
      o.momenta.reweighted_rounds = 2;
      o.momenta.sparsity = 4e-4;
      o.flow.divergence_weight = 1e-2;
      break;
    case SimilarityType::Ncc:
      o.momenta.regularisation = 2e-4;
      o.momenta.first_order_regularisation = 6e-5;
      o.momenta.sparsity = 4e-3;
      o.flow.divergence_weight = 0.1;
      break;
    case SimilarityType::Mi:  // of a normal pair -log(1 - c^2) / 2, the steeper the better the images fit
      o.momenta.regularisation = 1e-3;
      o.momenta.coarser_regularisation = 0.25;
      o.momenta.first_order_regularisation = 1.5e-3;
      o.momenta.sparsity = 4e-2;
      o.flow.divergence_weight = 2.5;
      break;
    case SimilarityType::Lncc:
      // Tissue hardly changes its volume but moves far: little weight on the momenta, much on the divergence.
      o.momenta.regularisation = 1e-4;
      o.momenta.first_order_regularisation = 1e-3;
      o.momenta.sparsity = 5e-2;
      o.flow.divergence_weight = -1;
      break;
    case SimilarityType::Ngf:
      o.momenta.regularisation = 1e-3;
      o.momenta.coarser_regularisation = 0.25;
      o.momenta.first_order_regularisation = 2e-3;
      o.momenta.sparsity = 4e-2;
      o.flow.divergence_weight = 0.2;
      break;
    case SimilarityType::Mind:  // a squared difference of a few hundredths
      o.momenta.regularisation = 2e-4;
      o.momenta.coarser_regularisation = 0.25;
      o.momenta.first_order_regularisation = 1e-4;
      o.momenta.sparsity = 4e-3;
      o.flow.divergence_weight = 0.08;
      break;
  }
  switch (preset) {
    case Preset::Fast:
      o.optimisation.max_iterations = 40;
      o.optimisation.tolerance = 2e-2;
      break;
    case Preset::Balanced:
      o.optimisation.max_iterations = 150;
      o.optimisation.tolerance = 5e-3;
      break;
    case Preset::Accurate:
      o.optimisation.max_iterations = 300;
      o.optimisation.tolerance = 1e-3;
      break;
  }
  // One step of the momenta loses nothing; with one step of the map as well, strongly compressed places fold
  // (core/measurements.md, "Time steps").
  o.flow.time_steps = preset == Preset::Accurate ? 2 : 1;
  if (similarity == SimilarityType::Ssd)  // auto: a level tells the next one how many its motion needs
    o.flow.map_steps = preset == Preset::Balanced && model != Model::Auto ? 3 : 2;
  else
    o.flow.map_steps = preset == Preset::Fast ? 1 : 2;
  if (similarity == SimilarityType::Ssd && is_sliding) {
    const double balanced = model == Model::Auto ? 2.5e-2 : 2e-2;
    o.optimisation.tolerance = preset == Preset::Fast ? 5e-2 : preset == Preset::Balanced ? balanced : 5e-3;
    o.momenta.full_contrast = 0.04;
  }
  if (similarity == SimilarityType::Ssd && o.momenta.first_order_scales > 0)
    o.optimisation.round_tolerance = model == Model::Auto ? 0.08 : 0.1;
  if (similarity != SimilarityType::Ssd) {
    // A short run loses nothing on the liver images (core/measurements.md, "Stopping").
    o.optimisation.tolerance = preset == Preset::Fast ? 5e-2 : preset == Preset::Balanced ? 2.5e-2 : 5e-3;
    o.momenta.first_order_waits = is_sliding;
    if (is_sliding && similarity == SimilarityType::Lncc) o.optimisation.noise_tolerance = 0.1;
    if (is_sliding) {
      o.momenta.reweighted_rounds = 1;
      o.momenta.sparsity_noise = 0.04;
    }
    if (preset == Preset::Fast) {  // first orders cost more than order 0: only the strongest jumps
      o.optimisation.max_iterations = 30;
      o.momenta.sparsity *= 4;
    }
  }
  if (model == Model::Auto) {
    // What is oblique has momenta of its own (core/measurements.md, "Sparsity").
    if (similarity != SimilarityType::Ssd) o.momenta.sparsity = -1;
    if (similarity == SimilarityType::Lncc) o.momenta.narrow_width_shear = -1;
    // With fast order 0 has not settled; with ssd accurate leaves as much in livers as in brains (core/measurements.md,
    // "Widths").
    if (preset == Preset::Balanced || (preset == Preset::Accurate && similarity != SimilarityType::Ssd))
      o.momenta.narrower_pull = -1;
    if (similarity != SimilarityType::Ssd && preset != Preset::Fast) o.optimisation.round_tolerance = -1;
    if (similarity != SimilarityType::Ssd && preset == Preset::Accurate) {
      // A second step of the momenta brings nothing here (core/measurements.md, "Finer images").
      o.flow.time_steps = 1;
      // These take the contrast from a few samples: finer images lead them astray by what is lost of their noise.
      if (similarity == SimilarityType::Lncc || similarity == SimilarityType::Ngf)
        o.similarity_parameters.lost_noise = 0;
    }
    if (similarity != SimilarityType::Ssd && preset == Preset::Balanced) {
      o.momenta.even_sparsity = 1.5;
      // Of the rounds with first orders, and of order 0 where a slip shows by then: else it has look_tolerance.
      if (similarity != SimilarityType::Ncc) o.optimisation.tolerance = similarity == SimilarityType::Ngf ? 3e-2 : 4e-2;
    }
    // Of ncc and mi, which are statistics of all that is compared, it would change the weight.
    if (similarity != SimilarityType::Ncc && similarity != SimilarityType::Mi) o.pyramid.region_margin = 4;
    o.flow.map_tolerance = preset == Preset::Fast ? 1 : preset == Preset::Balanced ? 0.4 : 0.2;
    // What first orders that are left out would have gone on to fit; order 0 alone is cheap (core/measurements.md,
    // "Stopping").
    if (similarity == SimilarityType::Lncc) o.optimisation.look_tolerance = 0.015;
    if (similarity == SimilarityType::Ssd || similarity == SimilarityType::Ncc || similarity == SimilarityType::Ngf)
      o.optimisation.look_tolerance = 0.006;
    if (similarity == SimilarityType::Mi || similarity == SimilarityType::Mind) o.optimisation.look_tolerance = 0.025;
  }
  // With ssd sliding loses more on the paper's rectangle than it gains elsewhere (core/measurements.md, "Sparsity").
  o.optimisation.keep_pairs = o.momenta.first_order_waits || model == Model::Auto;
  return o;
}

}  // namespace saltus
