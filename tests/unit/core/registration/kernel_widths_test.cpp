// The expert parameter kernel_widths, and that the scales are made of it.
#include <gtest/gtest.h>

#include <cmath>

#include "core/registration/scales.h"
#include "core/support/errors.h"

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
  const RegistrationOptions made = resolved(options, kCube, noise), again = resolved(made, kCube, noise);
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
      EXPECT_EQ(chosen(model, similarity, 0), " 6 9:1,4:0.7 none");
      EXPECT_EQ(chosen(model, similarity, 0.015), " 6 9:1,4:0.35 none");  // half at this noise
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

TEST(Noise, IsThatOfTheFinestLevel) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  set_parameter(options, "finest_level", "1");
  const double asked = options.momenta.sparsity;
  // A voxel of that level averages eight, so that the noise there is 0.04, at which the weight is doubled.
  const double noise = 0.04 * std::sqrt(8.0);
  const RegistrationOptions made = resolved(options, kCube, noise);
  EXPECT_NEAR(made.momenta.sparsity, 2 * asked, 1e-12);
  EXPECT_NEAR(resolved(made, kCube, noise).momenta.sparsity, 2 * asked, 1e-12);
  EXPECT_EQ(resolved(options, kCube, 0).momenta.sparsity, asked);
}

// Slices of 5 mm are as they are on levels of 2 and 4 mm; nor are three slices coarsened, however thin.
TEST(Noise, FallsOnlyAlongAxesThatTheLevelCoarsens) {
  const Lattice<3> thick{{128, 128, 20}, {1, 1, 5}, {}}, few{{128, 128, 3}, {1, 1, 1}, {}};
  for (const Lattice<3>& slices : {thick, few})
    for (int level : {1, 2}) {
      RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
      const double asked = options.momenta.sparsity;
      set_parameter(options, "finest_level", std::to_string(level));
      EXPECT_NEAR(resolved(options, slices, 0.04 * (1 << level)).momenta.sparsity, 2 * asked, 1e-12) << level;
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
