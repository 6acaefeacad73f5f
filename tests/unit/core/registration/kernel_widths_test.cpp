// The expert parameter kernel_widths, and that the scales are made of it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/phantom/make_phantom.h"
#include "core/registration/pyramid_run.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/support/errors.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

std::string listed(const RegistrationOptions& options) {
  for (const ParameterInfo& info : list_parameters(options))
    if (info.name == "kernel_widths") return info.value;
  return "not listed";
}

TEST(KernelWidths, AreReadAndListed) {
  RegistrationOptions options;
  EXPECT_EQ(listed(options), "none");
  set_parameter(options, "kernel_widths", "6:1,12:0.5");
  ASSERT_EQ(options.momenta.kernel_widths.size(), 2u);
  EXPECT_EQ(options.momenta.kernel_widths[1].voxels, 12);
  EXPECT_EQ(options.momenta.kernel_widths[1].weight, 0.5);
  EXPECT_EQ(listed(options), "6:1,12:0.5");
  EXPECT_TRUE(problems(options).empty());
  set_parameter(options, "kernel_widths", "none");
  EXPECT_TRUE(options.momenta.kernel_widths.empty());
}

TEST(KernelWidths, AreRefusedWithTheirValue) {
  RegistrationOptions options;
  for (const char* wrong : {"", "6", "6:", ":1", "6:1,", "6:1;12:1", "6:0", "6:-1", "0.5:1", "65:1", "6:inf", "nan:1",
                            "6:1,12:x", "1:1,1:1,1:1,1:1,1:1,1:1,1:1,1:1,1:1"}) {
    try {
      set_parameter(options, "kernel_widths", wrong);
      ADD_FAILURE() << "took '" << wrong << "'";
    } catch (const InvalidInput& error) {
      EXPECT_NE(std::string(error.what()).find("kernel_widths is '" + std::string(wrong) + "'"), std::string::npos)
          << error.what();
    }
    EXPECT_TRUE(options.momenta.kernel_widths.empty());
  }
}

TEST(KernelWidths, AreVoxelsOfEachScale) {
  const Lattice<2> image{{64, 64}, {0.5, 0.5}, {}};
  RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.kernel_widths = {{6, 3}, {10, 1}};
  const auto scales = make_scales<2, float>(image, resolved(options, image));
  ASSERT_GE(scales.size(), 2u);
  for (const auto& placed : scales) {
    const KernelSum& kernel = placed.scale->options().kernel;
    ASSERT_EQ(kernel.components().size(), 2u);
    EXPECT_DOUBLE_EQ(kernel.components()[0].weight, 0.75);
    EXPECT_DOUBLE_EQ(kernel.components()[0].profile->width(), std::ldexp(3.0, placed.level));
    EXPECT_DOUBLE_EQ(kernel.components()[1].profile->width(), std::ldexp(5.0, placed.level));
    EXPECT_EQ(kernel.name(), "wendland sum");
  }
}

TEST(KernelWidths, NarrowOnesCountTheirShareInTheFinestScaleOfOrderZero) {
  const Lattice<2> image{{64, 64}, {1, 1}, {}};
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  options.momenta.kernel_widths = {{4, 2}, {9, 1}, {6, 1}};
  options.momenta.first_order_kernel_widths = {{5, 1}, {3, 1}};
  const RegistrationOptions used = resolved(options, image);
  for (const auto& placed : make_scales<2, float>(image, used, {}, 0.25)) {
    const auto& components = placed.scale->options().kernel.components();
    if (placed.scale->has_first_order()) {
      EXPECT_DOUBLE_EQ(components[1].weight, 0.5);
      continue;
    }
    const bool is_finest = placed.level == used.momenta.finest_scale;
    EXPECT_DOUBLE_EQ(components[0].weight, is_finest ? 0.5 / 1.75 : 0.5) << placed.level;
    EXPECT_DOUBLE_EQ(components[1].weight, is_finest ? 1 / 1.75 : 0.25) << placed.level;
    EXPECT_DOUBLE_EQ(components[2].weight, is_finest ? 0.25 / 1.75 : 0.25) << placed.level;
  }
}

// As soon as first orders are there, order 0 has all of its widths again.
TEST(KernelWidths, AreWholeBesideFirstOrders) {
  const RegistrationInput<2> input = testing::pair_of(make_phantom<2>(default_phantom_options(PhantomKind::Slip)));
  for (double shear : {0.0, 1e9}) {
    RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
    options.momenta.kernel_widths = {{9, 1}, {4, 1}};
    options.momenta.finest_scale = 0;  // with first orders beside it and none before
    options.momenta.narrow_width_shear = 1e9;
    options.momenta.first_order_shear = shear == 0 ? 1e-9 : shear;
    options.threads = 1;
    const Field<double> no_directions;
    const ProgressCallback no_progress;
    const Checkpointing no_checkpoints;
    PyramidRun<2> run(input, options, no_directions, false, no_progress, no_checkpoints);
    run.run();
    const LevelSummary& finest = run.summary().levels.back();
    EXPECT_EQ(finest.narrow_share, kNarrowShareOfSmooth);
    EXPECT_EQ(finest.decision, shear == 0 ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
    int zeroth = 0;
    for (const auto* scale : run.scales())
      if (!scale->has_first_order() && scale->lattice().spacing[0] < 2 * (1 << run.options().flow.coarsening)) {
        ++zeroth;
        EXPECT_DOUBLE_EQ(scale->options().kernel.components()[1].weight,
                         shear == 0 ? 0.5 : kNarrowShareOfSmooth / (1 + kNarrowShareOfSmooth));
      }
    EXPECT_EQ(zeroth, 1);
  }
}

TEST(KernelWidths, OfFirstOrdersAloneAreTheirOwn) {
  const Lattice<2> image{{64, 64}, {1, 1}, {}};
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  set_parameter(options, "first_order_kernel_widths", "5:1,3:1");
  int zeroth = 0, first = 0;
  for (const auto& placed : make_scales<2, float>(image, resolved(options, image))) {
    const auto& components = placed.scale->options().kernel.components();
    ASSERT_EQ(components.size(), 2u);
    const bool is_first = placed.scale->has_first_order();
    ++(is_first ? first : zeroth);
    EXPECT_DOUBLE_EQ(components[0].profile->width(), std::ldexp(is_first ? 5.0 : 9.0, placed.level));
    EXPECT_DOUBLE_EQ(components[1].profile->width(), std::ldexp(is_first ? 3.0 : 4.0, placed.level));
  }
  EXPECT_GT(zeroth, 0);
  EXPECT_GT(first, 0);
}

const Lattice<3> kCube{{128, 128, 128}, {1, 1, 1}, {}};

/// Width and widths of both orders when nothing but `name` is given, for images with that noise.
std::string chosen(Model model, SimilarityType similarity, double noise, const char* name = nullptr,
                   const char* value = nullptr) {
  RegistrationOptions options = default_options(model, similarity, Preset::Accurate);  // to full resolution
  if (name) set_parameter(options, name, value);
  const RegistrationOptions made = resolved(options, kCube, {noise}), again = resolved(made, kCube, {noise});
  std::string text;
  for (const RegistrationOptions& once : {made, again}) {
    std::string found;
    for (const ParameterInfo& info : list_parameters(once))
      if (info.name == "width_voxels" || info.name == "kernel_widths" || info.name == "first_order_kernel_widths")
        found += " " + info.value;
    EXPECT_TRUE(text.empty() || text == found) << "not the same when resolved again";
    text = found;
  }
  return text;
}

TEST(KernelWidths, FollowModelSimilarityAndNoiseUnlessTheyAreGiven) {
  for (Model model : {Model::Gaussian, Model::Sliding, Model::Auto}) {
    for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Ncc, SimilarityType::Mi}) {
      EXPECT_EQ(chosen(model, similarity, 0), " 6 9:1,4:2 none");
      EXPECT_EQ(chosen(model, similarity, 0.008), " 6 9:1,4:1 none");  // half at this noise
      EXPECT_EQ(chosen(model, similarity, 0.3), " 6 9:1 none");
      EXPECT_EQ(chosen(model, similarity, 0, "width_voxels", "5"), " 5 none none");
      EXPECT_EQ(chosen(model, similarity, 0, "kernel_widths", "7:1"), " 6 7:1 none");
    }
    EXPECT_EQ(chosen(model, SimilarityType::Ssd, 0), " 6 none none");
    EXPECT_EQ(chosen(model, SimilarityType::Ssd, 0, "first_order_kernel_widths", "5:1"), " 6 none 5:1");
  }
  for (Model model : {Model::Wendland, Model::Wendland1, Model::Directional})
    EXPECT_EQ(chosen(model, SimilarityType::Lncc, 0), " 6 none none");
}

TEST(KernelWidths, AreNarrowLessOftenInTwoDimensions) {
  const auto narrow_weight = [](double noise) {
    const Lattice<2> square{{128, 128}, {1, 1}, {}};
    const RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Accurate);
    const RegistrationOptions made = resolved(options, square, {noise});
    EXPECT_EQ(made.momenta.kernel_widths.size(), 2u);
    return made.momenta.kernel_widths.back().weight;
  };
  EXPECT_EQ(narrow_weight(0), 0.7);
  EXPECT_EQ(narrow_weight(0.015), 0.35);
}

TEST(Noise, IsThatOfTheFinestLevel) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  set_parameter(options, "finest_level", "1");
  const double asked = options.momenta.sparsity;
  // A voxel of that level averages eight, so that the noise there is 0.04, at which the weight is doubled.
  const double noise = 0.04 * std::sqrt(8.0);
  const RegistrationOptions made = resolved(options, kCube, {noise});
  EXPECT_NEAR(made.momenta.sparsity, 2 * asked, 1e-12);
  EXPECT_NEAR(resolved(made, kCube, {noise}).momenta.sparsity, 2 * asked, 1e-12);
  EXPECT_EQ(resolved(options, kCube, {0}).momenta.sparsity, asked);
}

// Slices of 5 mm are as they are on levels of 2 and 4 mm; nor are three slices coarsened, however thin.
TEST(Noise, FallsOnlyAlongAxesThatTheLevelCoarsens) {
  const Lattice<3> thick{{128, 128, 20}, {1, 1, 5}, {}}, few{{128, 128, 3}, {1, 1, 1}, {}};
  for (const Lattice<3>& slices : {thick, few})
    for (int level : {1, 2}) {
      RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
      const double asked = options.momenta.sparsity;
      set_parameter(options, "finest_level", std::to_string(level));
      EXPECT_NEAR(resolved(options, slices, {0.04 * (1 << level)}).momenta.sparsity, 2 * asked, 1e-12) << level;
    }
}

/// What is said of first_order_kernel_widths with `model` and these settings; "" when they are taken.
std::string refusal(Model model, const std::vector<std::pair<const char*, const char*>>& settings, bool is_resolved) {
  RegistrationOptions options = default_options(model, SimilarityType::Lncc, Preset::Balanced);
  set_parameter(options, "first_order_kernel_widths", "5:1,3:1");
  for (const auto& [name, value] : settings) set_parameter(options, name, value);
  if (is_resolved) options = resolved(options, kCube);  // whose finest level is 1, of 3
  std::string all;
  for (const std::string& one : problems(options)) all += one;
  return all;
}

// Oracle: the scales that are made.
TEST(KernelWidths, OfFirstOrdersAloneAreRefusedWhereNoScaleHasThem) {
  struct Case {
    Model model;
    std::vector<std::pair<const char*, const char*>> settings;
    bool is_known = true;  ///< without an image
  };
  const std::vector<Case> cases = {
      {Model::Gaussian, {}},
      {Model::Gaussian, {{"first_order_scales", "1"}}},
      {Model::Sliding, {}},
      {Model::Auto, {}},
      {Model::Auto, {{"first_order_scales", "0"}}},
      {Model::Wendland, {}},
      {Model::Wendland, {{"first_order_scales", "1"}}},
      {Model::Wendland1, {}},
      {Model::Wendland1, {{"finest_scale", "2"}}},
      {Model::Wendland1, {{"finest_scale", "1"}, {"first_order_finest_scale", "1"}}},
      {Model::Wendland1, {{"finest_scale", "1"}}, false},
      {Model::Wendland1, {{"finest_scale", "1"}, {"first_order_finest_scale", "2"}}, false},
      {Model::Wendland1, {{"finest_scale", "1"}, {"first_order_finest_scale", "2"}, {"scales", "2"}}},
      {Model::Wendland1, {{"finest_scale", "1"}, {"first_order_finest_scale", "3"}, {"scales", "2"}}},
      {Model::Directional, {}},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(to_string(one.model) + (one.settings.empty() ? "" : std::string(" ") + one.settings[0].first));
    RegistrationOptions options = default_options(one.model, SimilarityType::Lncc, Preset::Balanced);
    for (const auto& [name, value] : one.settings) set_parameter(options, name, value);
    EXPECT_EQ(problems(options), std::vector<std::string>{}) << "it is not what is refused";
    const Field<double> along(3 * kCube.sites(), std::sqrt(1.0 / 3));
    const auto scales = make_scales<3, float>(kCube, resolved(options, kCube), along);
    const bool is_used = std::any_of(scales.begin(), scales.end(), [](const auto& placed) {
      const Orders orders = placed.scale->options().orders;
      return orders == Orders::First || orders == Orders::Oriented;
    });
    const std::string said = refusal(one.model, one.settings, true), before = refusal(one.model, one.settings, false);
    EXPECT_EQ(before, one.is_known ? said : "");
    EXPECT_EQ(said.empty(), is_used) << said;
    if (is_used) continue;
    EXPECT_EQ(said, "parameter first_order_kernel_widths is 5:1,3:1 and model " + to_string(one.model) +
                        " has no scale of order 1 alone, which it is for; set it to none, or choose model sliding or "
                        "auto with first_order_scales above 0");
  }
}

// What depends on the image is said when it is there, before any work.
TEST(KernelWidths, OfFirstOrdersAloneAreRefusedWithTheImage) {
  RegistrationInput<2> input;
  ImageGrid<2> grid;
  grid.size = {40, 40};
  input.fixed = input.moving = Volume<2>(grid);
  input.moving.samples[7] = input.fixed.samples[8] = 1;
  RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ssd, Preset::Balanced);
  set_parameter(options, "first_order_kernel_widths", "5:1");
  set_parameter(options, "finest_scale", "0");
  ASSERT_TRUE(problems(options).empty());
  try {
    register_images<2>(input, options, [](const Progress&) {
      ADD_FAILURE() << "work began";
      return ProgressAnswer::Stop;
    });
    ADD_FAILURE() << "accepted";
  } catch (const InvalidInput& error) {
    EXPECT_NE(std::string(error.what()).find("first_order_kernel_widths is 5:1"), std::string::npos) << error.what();
  }
}

TEST(KernelWidths, AWidthIsAtLeastAVoxel) {
  RegistrationOptions options;
  for (const char* wrong : {"0.5", "-1", "65", "nan"})
    EXPECT_THROW(set_parameter(options, "width_voxels", wrong), InvalidInput) << wrong;
  set_parameter(options, "width_voxels", "1");
  EXPECT_EQ(options.momenta.width_voxels, 1);
  set_parameter(options, "width_voxels", "0");
  EXPECT_EQ(options.momenta.width_voxels, 0);
}

}  // namespace
}  // namespace saltus
