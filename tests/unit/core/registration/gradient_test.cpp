// Oracle: the definition of the derivative. For E with gradient g, |E(m + e w) - E(m) - e <g, w>| falls as e^2.
#include "core/registration/matching_objective.h"
#include "core/registration/scales.h"
#include "tests/support/random_fields.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

enum class Masks { None, Fixed, Both };

struct Case {
  Model model;
  SimilarityType similarity;
  Masks masks;
  Evolution evolution = Evolution::Exact;
  std::vector<KernelWidth> kernel_widths = {};
  double similarity_weight = 1;
  int coarsening = 0;           // of order 0
  bool is_flow_coarse = false;  // and of the flow
  int orientations = 0;
  bool elements_alone = false;  // without fields beside them, and narrow
};

template <int Dim>
Lattice<Dim> small_lattice() {
  Lattice<Dim> lattice;
  const int size[3] = {19, 17, 9};
  const double spacing[3] = {1.0, 1.25, 1.9};
  for (int axis = 0; axis < Dim; ++axis) {
    lattice.size[axis] = size[axis];
    lattice.spacing[axis] = spacing[axis];
  }
  return lattice;
}

template <int Dim>
void expect_taylor_slope_two(const Case& test) {
  using testing::random_field;
  using testing::random_values;
  using testing::random_waves;
  omp_set_num_threads(1);  // small problems: threads would only wait for each other
  const Lattice<Dim> lattice = small_lattice<Dim>();
  RegistrationOptions options = default_options(test.model, test.similarity, Preset::Balanced);
  options.momenta.width_voxels = 4;
  options.momenta.kernel_widths = test.kernel_widths;
  options.momenta.scales = 2;
  options.momenta.finest_scale = 0;
  options.momenta.first_order_finest_scale = test.is_flow_coarse ? test.coarsening : 0;
  if (options.momenta.first_order_scales > 0) options.momenta.first_order_scales = test.model == Model::Sliding ? 1 : 2;
  options.momenta.regularisation = options.momenta.first_order_regularisation = 0.05;
  if (test.orientations > 0) options.momenta.orientations = Dim == 2 ? 8 : 13;
  options.momenta.oriented_width = test.elements_alone ? 0.5 : 1;
  options.momenta.oriented_sparsity = 0.4;
  if (test.elements_alone) options.momenta.oriented_alone = 2;
  options.flow.coarsening = test.coarsening;
  Field<double> directions;  // any unit vectors, and none here and there
  if (test.model == Model::Directional) {
    directions = random_field(Dim * lattice.sites(), 72);  // a seed whose scene has no kink within the steps below
    for (std::size_t site = 0; site < lattice.sites(); ++site) {
      Eigen::Map<Vector<Dim>> w(directions.data() + Dim * site);
      w = site % 5 == 0 ? Vector<Dim>::Zero() : Vector<Dim>(w.normalized());
    }
  }
  if (options.momenta.orientations < 0) options.momenta.orientations = Dim == 2 ? 8 : 9;  // as resolved
  auto placed = make_scales<Dim, double>(lattice, options, directions);
  std::vector<MomentumScale<Dim, double>*> scales;
  for (auto& scale : placed) scales.push_back(scale.scale.get());

  MatchingLevel<Dim, double> level;
  level.lattice = lattice;
  level.fixed = random_waves<Dim>(lattice, 1);
  level.moving.lattice = lattice;
  level.moving.samples = random_waves<Dim>(lattice, 2);
  level.moving.linear = Matrix<Dim>::Zero();
  for (int axis = 0; axis < Dim; ++axis) level.moving.linear(axis, axis) = 1 / lattice.spacing[axis];
  level.moving.linear(0, 1) = 0.1;  // an affine start: the moving grid is oblique to the frame
  level.moving.offset = Vector<Dim>::Constant(0.2);
  if (test.masks != Masks::None) {
    level.fixed_weights = random_values(lattice.sites(), 3, 0.5);
    for (double& weight : level.fixed_weights) weight += 0.5;
  }
  if (test.masks == Masks::Both) {
    level.moving_weights = level.moving;
    level.moving_weights.samples = random_waves<Dim>(lattice, 4);
    for (double& weight : level.moving_weights.samples) weight = 0.5 + 0.2 * weight;
  }
  level.time_steps = 2;
  level.map_steps = 2;
  level.similarity_weight = test.similarity_weight;
  level.divergence_weight = 0.3;
  level.evolution = test.evolution;

  MatchingObjective<Dim, double> objective(
      scales, level, make_similarity<Dim, double>(test.similarity, lattice, options.similarity_parameters, 1.0), 0.0,
      test.is_flow_coarse ? flow_lattice_beside_first(lattice, options, 0) : lattice);
  std::vector<std::vector<std::uint32_t>> elements(scales.size());
  for (std::size_t s = 0; s < scales.size(); ++s) {
    OrientedMomenta<Dim, double>* oriented = scales[s]->oriented();
    if (!oriented) continue;
    std::vector<double> normals = random_values(scales[s]->field_size(), 73);
    for (std::size_t site = 0; site < scales[s]->lattice().sites(); ++site)
      Eigen::Map<Vector<Dim>>(normals.data() + Dim * site).normalize();
    oriented->turn(normals);
    const std::vector<std::uint32_t>& candidates = oriented->candidates();
    for (std::size_t i = 0; i < candidates.size(); i += 5) elements[s].push_back(candidates[i]);
    for (std::uint32_t e = 2; e < oriented->elements(); e += 111) elements[s].push_back(e);
    std::sort(elements[s].begin(), elements[s].end());
    elements[s].erase(std::unique(elements[s].begin(), elements[s].end()), elements[s].end());
  }
  objective.working_set().set_active_elements(elements);
  const std::size_t size = objective.size();
  std::vector<double> at = random_values(size, test.is_flow_coarse ? 9 : 5, 0.03);  // without a kink so near
  for (const GroupSparsity& range : objective.sparsity())  // some elements have no momentum yet
    for (std::size_t i = range.begin; test.orientations > 0 && range.group == Dim - 1 && i < range.end;
         i += 4 * (Dim - 1))
      std::fill_n(at.begin() + static_cast<std::ptrdiff_t>(i), Dim - 1, 0.0);
  std::vector<double> gradient(size), preconditioned(size), ignored(size), ignored_too(size);
  const Evaluation start = objective.evaluate(at, gradient, preconditioned);
  ASSERT_TRUE(start.is_valid);
  double size2 = 0;
  for (double g : gradient) size2 += g * g;

  // Linear interpolation has kinks at cell borders, which disturb single steps; over eight directions and a factor of
  // 64 in the step the order shows. A wrong gradient has order 1.
  const double least = test.is_flow_coarse ? 1e-6 : 1e-5;  // many sites move together there, and meet borders together
  const std::vector<double> steps = {64 * least, 16 * least, 4 * least, least};
  std::vector<double> remainders(steps.size(), 0.0);
  double slopes = 0;
  for (int direction = 0; direction < 8; ++direction) {
    // A random direction, with a part along the gradient so that the slope is not small by chance.
    std::vector<double> along = random_values(size, 6 + direction, 0.03);
    double slope = 0;
    for (std::size_t i = 0; i < size; ++i) along[i] += 0.1 * gradient[i] / std::sqrt(size2);
    for (std::size_t i = 0; i < size; ++i) slope += gradient[i] * along[i];
    slopes += std::abs(slope);
    for (std::size_t k = 0; k < steps.size(); ++k) {
      std::vector<double> moved = at;
      for (std::size_t i = 0; i < size; ++i) moved[i] += steps[k] * along[i];
      remainders[k] += std::abs(objective.evaluate(moved, ignored, ignored_too).value - start.value - steps[k] * slope);
    }
  }
  const double order = std::log2(remainders.front() / remainders.back()) / 6;
  EXPECT_GT(order, 1.7) << "remainders " << remainders.front() << " to " << remainders.back() << ", slopes " << slopes;
  // First-order agreement, so that a wrong but tiny part cannot hide.
  EXPECT_LT(remainders.back(), 1e-3 * steps.back() * slopes);
}

class Gradient : public ::testing::TestWithParam<Case> {};

TEST_P(Gradient, HasTaylorSlopeTwoInTwoDimensions) { expect_taylor_slope_two<2>(GetParam()); }
TEST_P(Gradient, HasTaylorSlopeTwoInThreeDimensions) { expect_taylor_slope_two<3>(GetParam()); }

std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (Model model : all_models())
    for (SimilarityType similarity : all_similarities())
      for (Masks masks : {Masks::None, Masks::Both}) cases.push_back({model, similarity, masks});
  for (Model model : {Model::Gaussian, Model::Wendland1, Model::Directional})
    for (Evolution evolution : {Evolution::PerOrder, Evolution::Carried})
      cases.push_back({model, SimilarityType::Ssd, Masks::None, evolution});
  for (Model model : {Model::Gaussian, Model::Wendland1, Model::Directional, Model::Sliding})
    cases.push_back({model, SimilarityType::Ssd, Masks::None, Evolution::Exact, {{3, 1}, {8, 0.5}}});
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Ncc})
    cases.push_back({Model::Gaussian, similarity, Masks::Both, Evolution::Exact, {}, 7});
  cases.push_back({Model::Wendland, SimilarityType::Lncc, Masks::Fixed});
  for (int coarsening : {1, 2})
    for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc})
      for (Masks masks : {Masks::None, Masks::Fixed, Masks::Both})
        cases.push_back({Model::Gaussian, similarity, masks, Evolution::Carried, {}, 1, coarsening, true});
  cases.push_back({Model::Sliding, SimilarityType::Lncc, Masks::None, Evolution::Carried, {}, 1, 1, false});
  // The flow where first orders are, both coarser than the images: along the axes, and elements alone.
  for (Masks masks : {Masks::None, Masks::Both}) {
    cases.push_back({Model::Sliding, SimilarityType::Lncc, masks, Evolution::Carried, {}, 1, 1, true});
    cases.push_back({Model::Sliding, SimilarityType::Ncc, masks, Evolution::Carried, {}, 1, 1, true, 1, true});
  }
  for (Model model : {Model::Sliding, Model::Wendland1})  // alone on its lattice, and with order 0
    for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder, Evolution::Carried})
      cases.push_back({model, SimilarityType::Ssd, Masks::None, evolution, {}, 1, 0, false, 1});
  for (Evolution evolution : {Evolution::Exact, Evolution::Carried})
    cases.push_back({Model::Sliding, SimilarityType::Ncc, Masks::Both, evolution, {}, 1, 0, false, 1, true});
  return cases;
}

INSTANTIATE_TEST_SUITE_P(Models, Gradient, ::testing::ValuesIn(all_cases()), [](const auto& info) {
  return to_string(info.param.model) + "_" + to_string(info.param.similarity) +
         (info.param.masks == Masks::None    ? ""
          : info.param.masks == Masks::Fixed ? "_fixed_mask"
                                             : "_masks") +
         (info.param.similarity_weight == 1 ? "" : "_weighed") + (info.param.kernel_widths.empty() ? "" : "_sum") +
         (info.param.evolution == Evolution::Exact      ? ""
          : info.param.evolution == Evolution::PerOrder ? "_per_order"
                                                        : "_carried") +
         (info.param.orientations == 0 ? "" : "_oriented") + (info.param.elements_alone ? "_alone" : "") +
         (info.param.coarsening == 0 ? "" : "_coarsened_" + std::to_string(info.param.coarsening)) +
         (info.param.is_flow_coarse ? "_with_flow" : "");
});

}  // namespace
}  // namespace saltus
