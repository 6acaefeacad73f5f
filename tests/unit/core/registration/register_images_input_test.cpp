#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/registration/register_images.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

using ::testing::HasSubstr;

RegistrationInput<2> good() {
  ImageGrid<2> grid;
  grid.size = {8, 6};
  RegistrationInput<2> input;
  input.fixed = input.moving = Volume<2>(grid);
  for (std::size_t i = 0; i < 48; ++i) input.fixed.samples[i] = input.moving.samples[i] = static_cast<float>(i % 7);
  return input;
}

RegistrationOptions options() { return default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Fast); }

/// What register_images says; nothing of the registration may have begun.
std::string refusal(const RegistrationInput<2>& input, const RegistrationOptions& how = options()) {
  try {
    register_images<2>(input, how, [](const Progress&) -> ProgressAnswer {
      ADD_FAILURE() << "work began";
      return ProgressAnswer::Stop;
    });
  } catch (const InvalidInput& error) {
    return error.what();
  }
  return "accepted";
}

TEST(RegisterImagesInput, NamesAValueThatIsNotFinite) {
  for (float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                    -std::numeric_limits<float>::infinity()}) {
    RegistrationInput<2> input = good();
    input.fixed.samples[13] = bad;
    EXPECT_EQ(refusal(input),
              "fixed image holds a value that is not finite at voxel 13; replace NaN and Inf before registering");
    input = good();
    input.moving.samples[47] = bad;
    EXPECT_THAT(refusal(input), HasSubstr("moving image holds a value that is not finite at voxel 47"));
  }
}

TEST(RegisterImagesInput, NamesAnImageWithoutItsSamples) {
  RegistrationInput<2> input = good();
  input.moving.samples.pop_back();
  EXPECT_EQ(refusal(input), "moving image has 47 samples; its grid needs 48");
  input = good();
  input.fixed.grid.spacing[1] = 0;
  EXPECT_THAT(refusal(input), HasSubstr("fixed image: "));
  EXPECT_THAT(refusal(input), HasSubstr("spacing"));
}

// Its transpose is taken for its inverse; readers of files make rotations of what headers have rounded.
TEST(RegisterImagesInput, NamesADirectionThatIsNoRotation) {
  RegistrationInput<2> input = good();
  input.moving.grid.direction(0, 1) = 1e-8;
  EXPECT_EQ(problems(input.moving.grid).size(), 0u);
  input.moving.grid.direction(0, 1) = 1e-5;
  EXPECT_THAT(refusal(input), HasSubstr("orthonormal"));
  EXPECT_EQ(problems(input.moving.grid, kRoundedDirection).size(), 0u);
}

TEST(RegisterImagesInput, NamesImagesThatDoNotOverlap) {
  RegistrationInput<2> input = good();
  input.moving.grid.origin = {1000, 1000};
  EXPECT_THAT(refusal(input), HasSubstr("do not overlap"));
  EXPECT_THAT(refusal(input), HasSubstr("(1000 1000) to (1007 1005)"));
  input.start.offset = {1000, 1000};  // a start that brings them together is the way out
  EXPECT_NO_THROW(register_images<2>(input, options()));
  input.start.offset = {1007.4, 1005.4};
  input.fixed_mask = Volume<2>(input.fixed.grid, 1.0f);
  input.fixed_mask->samples[0] = 0;  // only the hidden corner would meet the moving image
  EXPECT_THAT(refusal(input), HasSubstr("do not overlap"));
}

TEST(RegisterImagesInput, NamesAnImageOfOneVoxel) {
  RegistrationInput<2> input = good();
  input.moving.grid.size = {1, 1};
  input.moving.samples.resize(1);
  EXPECT_EQ(refusal(input), "moving image has a single voxel; there is nothing to register");
}

TEST(RegisterImagesInput, NamesAMaskThatDoesNotFitItsImage) {
  ImageGrid<2> small = good().fixed.grid;
  small.size = {8, 5};
  RegistrationInput<2> input = good();
  input.fixed_mask = Volume<2>(small, 1.0f);
  EXPECT_EQ(refusal(input), "fixed mask is 8x5; its image is 8x6, they must be on the same grid");
  input = good();
  input.moving_mask = Volume<2>(small, 1.0f);
  EXPECT_THAT(refusal(input), HasSubstr("moving mask is 8x5"));
}

TEST(RegisterImagesInput, NamesAMaskThatLiesElsewhereThanItsImage) {
  for (int what : {0, 1, 2}) {
    ImageGrid<2> elsewhere = good().fixed.grid;
    if (what == 0) elsewhere.origin[0] += 2;
    if (what == 1) elsewhere.spacing[1] = 1.5;
    if (what == 2) elsewhere.direction << -1, 0, 0, 1;
    RegistrationInput<2> input = good();
    input.fixed_mask = Volume<2>(elsewhere, 1.0f);
    EXPECT_THAT(refusal(input), HasSubstr("fixed mask lies")) << what;
    EXPECT_THAT(refusal(input), HasSubstr("same grid")) << what;
  }
  // Headers that were rounded to single precision still fit.
  RegistrationInput<2> input = good();
  ImageGrid<2> rounded = input.fixed.grid;
  rounded.origin[0] += 1e-5;
  rounded.spacing[1] += 1e-7;
  input.fixed_mask = Volume<2>(rounded, 1.0f);
  RegistrationOptions how = options();
  how.optimisation.max_iterations = 0;
  EXPECT_NO_THROW(register_images<2>(input, how));
}

TEST(RegisterImagesInput, NamesAMaskThatHidesEverything) {
  RegistrationInput<2> input = good();
  input.fixed_mask = Volume<2>(input.fixed.grid, 0.0f);
  EXPECT_EQ(refusal(input), "fixed mask is 0 everywhere; it must be positive where the image counts");
  input = good();
  input.moving_mask = Volume<2>(input.fixed.grid, -1.0f);
  EXPECT_THAT(refusal(input), HasSubstr("moving mask is 0 everywhere"));
}

TEST(RegisterImagesInput, NamesAStartThatIsNoInvertibleMap) {
  RegistrationInput<2> input = good();
  input.start.offset[1] = std::nan("");
  EXPECT_THAT(refusal(input), HasSubstr("start"));
  EXPECT_THAT(refusal(input), HasSubstr("finite"));
  input = good();
  input.start.linear(0, 1) = std::numeric_limits<double>::infinity();
  EXPECT_THAT(refusal(input), HasSubstr("finite"));
  input = good();
  input.start.linear << 1, 2, 2, 4;
  EXPECT_THAT(refusal(input), HasSubstr("start"));
  EXPECT_THAT(refusal(input), HasSubstr("invert"));
}

TEST(RegisterImagesInput, NamesAnOptionOutOfItsRange) {
  RegistrationOptions how = options();
  how.flow.time_steps = 0;
  EXPECT_EQ(refusal(good(), how), "parameter time_steps is 0; it must be 1 to 64");
  how = options();
  how.pyramid.levels = how.pyramid.finest_level = 2;
  EXPECT_THAT(refusal(good(), how), HasSubstr("finest_level"));
  how = options();
  how.threads = -1;
  EXPECT_EQ(refusal(good(), how), "threads is -1; it must be 0 or more");
}

// The smallest images there are: they end with a result.
TEST(RegisterImagesInput, TakesTinyAndThinImages) {
  for (const Index<3>& size : {Index<3>{2, 2, 2}, {2, 1, 1}, {9, 1, 1}, {12, 10, 1}, {1, 8, 3}}) {
    ImageGrid<3> grid;
    grid.size = size;
    RegistrationInput<3> input;
    input.fixed = input.moving = Volume<3>(grid);
    for (std::size_t i = 0; i < grid.voxels(); ++i) {
      input.fixed.samples[i] = static_cast<float>((i * 7) % 5);
      input.moving.samples[i] = static_cast<float>((i * 3) % 4);
    }
    for (const auto& [model, similarity] :
         {std::pair{Model::Gaussian, SimilarityType::Ssd}, {Model::Sliding, SimilarityType::Lncc}}) {
      RegistrationOptions how = default_options(model, similarity, Preset::Fast);
      how.optimisation.max_iterations = 3;
      const RegistrationResult<3> result = register_images<3>(input, how);
      for (float u : result.displacement.samples) ASSERT_TRUE(std::isfinite(u));
      for (float j : result.jacobian.samples) ASSERT_TRUE(std::isfinite(j));
    }
  }
}

}  // namespace
}  // namespace saltus
