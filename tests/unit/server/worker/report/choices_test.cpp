// Oracle: the options that were asked for, and what resolved() makes of them.
#include "server/worker/report/choices.h"
#include "core/registration/scales.h"
#include "tests/unit/server/worker/report/report_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::report {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

/// Everything that is said of `name` after a registration of `model` and `similarity` with these settings, whose images
/// have noise of 1.5 %: "value (why)", for each line.
std::vector<std::string> said_of(const std::string& name, Model model, SimilarityType similarity,
                                 const std::vector<std::pair<const char*, const char*>>& settings = {},
                                 Preset preset = Preset::Accurate) {  // to full resolution, where the noise is whole
  constexpr double noise = 0.015;
  ReportScene<3> scene(3);
  scene.options = default_options(model, similarity, preset);
  for (const auto& [setting, value] : settings) set_parameter(scene.options, setting, value);
  scene.result.options = resolved(scene.options, lattice_of(scene.images.fixed.grid), {noise});
  scene.result.summary.noise = noise;
  std::vector<std::string> lines;
  for (const Choice& choice : choices(scene.report))
    if (choice.name == name) lines.push_back(choice.value + " (" + choice.why + ")");
  return lines;
}

using Lines = std::vector<std::string>;

TEST(Choices, TellTheWidthsThatAreInUse) {
  const std::string from_noise = " (from the model, the similarity and the noise on the finest level)";
  // 2 / (1 + (0.015 / 0.008)^2) with this noise, core/measurements.md, "Widths"; order 1, with scales of its own, keeps
  // one.
  EXPECT_EQ(said_of("kernel_widths", Model::Auto, SimilarityType::Lncc), Lines{"9:1,4:0.443" + from_noise});
  EXPECT_EQ(said_of("width_voxels", Model::Auto, SimilarityType::Lncc),
            Lines{"6 (of the scales of order 1 alone, from the model and the similarity)"});
  // No scale has one width.
  EXPECT_EQ(said_of("kernel_widths", Model::Gaussian, SimilarityType::Lncc), Lines{"9:1,4:0.443" + from_noise});
  EXPECT_THAT(said_of("width_voxels", Model::Gaussian, SimilarityType::Lncc), IsEmpty());
  EXPECT_THAT(said_of("width_voxels", Model::Auto, SimilarityType::Lncc, {{"first_order_kernel_widths", "5:1,3:1"}}),
              IsEmpty());
  // All have.
  for (Model model : {Model::Gaussian, Model::Auto, Model::Wendland1}) {
    EXPECT_THAT(said_of("kernel_widths", model, SimilarityType::Ssd), IsEmpty()) << to_string(model);
    EXPECT_EQ(said_of("width_voxels", model, SimilarityType::Ssd),
              Lines{"6 (of all scales, from the model and the similarity)"})
        << to_string(model);
  }
  EXPECT_EQ(said_of("width_voxels", Model::Auto, SimilarityType::Ssd, {{"first_order_kernel_widths", "5:1"}}),
            Lines{"6 (of the scales with order 0, from the model and the similarity)"});
}

TEST(Choices, TellTheWidthsThatTheJobSet) {
  EXPECT_EQ(said_of("width_voxels", Model::Gaussian, SimilarityType::Lncc, {{"width_voxels", "5"}}),
            Lines{"5 (set by the job; the default is 0)"});
  EXPECT_THAT(said_of("kernel_widths", Model::Gaussian, SimilarityType::Lncc, {{"width_voxels", "5"}}), IsEmpty());
  EXPECT_EQ(said_of("kernel_widths", Model::Gaussian, SimilarityType::Lncc, {{"kernel_widths", "7:1"}}),
            Lines{"7:1 (set by the job; the default is none)"});
  EXPECT_EQ(
      said_of("first_order_kernel_widths", Model::Auto, SimilarityType::Lncc, {{"first_order_kernel_widths", "5:1"}}),
      Lines{"5:1 (set by the job; the default is none)"});
}

// lncc doubles its weight, 0.025 in 3-D, at noise of 4 %; ssd's does not follow the noise.
TEST(Choices, TellTheSparsityThatNoiseMakes) {
  const std::string from_noise = " (from the noise on the finest level (sparsity_noise))";
  const std::string from_all =
      " (from the model, the similarity, the preset and the dimension; the noise on the finest level (sparsity_noise))";
  EXPECT_EQ(said_of("sparsity", Model::Auto, SimilarityType::Lncc, {{"sparsity_noise", "0"}}),
            Lines{"0.025 (from the model, the similarity, the preset and the dimension)"});
  EXPECT_EQ(said_of("sparsity in use", Model::Wendland1, SimilarityType::Mi, {{"sparsity", "-1"}}),
            Lines{"0.04 (from the model, the similarity, the preset and the dimension)"});
  EXPECT_EQ(said_of("sparsity", Model::Sliding, SimilarityType::Mi), Lines{"0.055" + from_noise});
  EXPECT_EQ(said_of("sparsity", Model::Auto, SimilarityType::Lncc), Lines{"0.034375" + from_all});
  EXPECT_THAT(said_of("sparsity in use", Model::Auto, SimilarityType::Lncc), IsEmpty());
  EXPECT_EQ(said_of("sparsity", Model::Auto, SimilarityType::Lncc, {{"sparsity", "0.1"}}),
            Lines{"0.1 (set by the job; the default is -1)"});
  EXPECT_EQ(said_of("sparsity in use", Model::Auto, SimilarityType::Lncc, {{"sparsity", "0.1"}}),
            Lines{"0.1375" + from_noise});
  EXPECT_EQ(said_of("sparsity_noise", Model::Auto, SimilarityType::Lncc, {{"sparsity_noise", "0.06"}}),
            Lines{"0.06 (set by the job; the default is 0.04)"});
  EXPECT_THAT(said_of("sparsity_noise in use", Model::Auto, SimilarityType::Lncc, {{"sparsity_noise", "0.06"}}),
              IsEmpty());
  EXPECT_EQ(said_of("sparsity", Model::Auto, SimilarityType::Lncc, {{"sparsity_noise", "0.06"}}),
            Lines{"0.03125" + from_all});
  for (const char* name : {"sparsity", "sparsity in use", "sparsity_noise"})
    EXPECT_THAT(said_of(name, Model::Auto, SimilarityType::Ssd), IsEmpty()) << name;
  EXPECT_THAT(said_of("sparsity_noise", Model::Auto, SimilarityType::Lncc), IsEmpty());
}

TEST(Choices, TellWhatALowContrastMakes) {
  ReportScene<3> scene(3);
  scene.options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Fast);
  set_parameter(scene.options, "finest_level", "0");
  set_parameter(scene.options, "full_contrast", "0.08");
  scene.result.options = resolved(scene.options, lattice_of(scene.images.fixed.grid), {0, 0.04});
  const auto all = choices(scene.report);
  for (const char* name : {"sparsity", "regularisation_beside_first", "oriented_alone", "first_round_tolerance",
                           "round_tolerance", "tolerance"})
    EXPECT_THAT(all, Contains(AllOf(Field(&Choice::name, name), Field(&Choice::is_set, false),
                                    Field(&Choice::why, HasSubstr("contrast")))))
        << name;
  EXPECT_THAT(all, Contains(AllOf(Field(&Choice::name, "full_contrast"), Field(&Choice::value, "0.08"))));
  EXPECT_THAT(all, Not(Contains(Field(&Choice::name, "full_contrast in use"))));
  for (const char* name : {"round_tolerance", "tolerance"})
    EXPECT_THAT(said_of(name, Model::Auto, SimilarityType::Ssd), IsEmpty()) << name;
  EXPECT_THAT(said_of("first_round_tolerance", Model::Auto, SimilarityType::Lncc), IsEmpty());
}

TEST(Choices, TellWhereFirstWeightsAreFrom) {
  const std::string measured =
      " (from the similarity and the dimension, where oriented momenta are alone and wait for order 0, "
      "reweighted rounds follow and the path of weights is the usual one)";
  EXPECT_EQ(said_of("shear_weights", Model::Auto, SimilarityType::Lncc), Lines{"2" + measured});
  EXPECT_EQ(said_of("shear_weights", Model::Auto, SimilarityType::Lncc, {{"shear_weights", "0"}}),
            Lines{"0 (set by the job; the default is -1)"});
  EXPECT_EQ(said_of("shear_weights", Model::Auto, SimilarityType::Lncc, {{"sparsity_path", "2"}}),
            Lines{"0" + measured});
  EXPECT_THAT(said_of("shear_weights", Model::Auto, SimilarityType::Lncc, {{"orientations", "0"}}), IsEmpty());
  EXPECT_THAT(said_of("shear_weights", Model::Sliding, SimilarityType::Lncc), IsEmpty());
}

TEST(Choices, TellHowMuchOfTheNoiseMayBeLost) {
  const std::string from = " (from the similarity, and whether the images are finer than with balanced)";
  EXPECT_EQ(said_of("lost_noise", Model::Auto, SimilarityType::Lncc), Lines{"0.003" + from});
  EXPECT_THAT(said_of("lost_noise", Model::Auto, SimilarityType::Lncc, {}, Preset::Balanced), IsEmpty());
  EXPECT_THAT(said_of("lost_noise", Model::Auto, SimilarityType::Mi), IsEmpty());
  EXPECT_THAT(said_of("lost_noise", Model::Sliding, SimilarityType::Lncc), IsEmpty());
  EXPECT_THAT(said_of("lost_noise", Model::Auto, SimilarityType::Lncc, {{"smoothing_voxels", "1"}}), IsEmpty());
}

// 0 is not what is used, and a report must not read as if it were.
TEST(Choices, TellTheRegularisationInUse) {
  const std::string measured = " (from the similarity and the dimension, for which it was measured)";
  EXPECT_EQ(said_of("regularisation", Model::Auto, SimilarityType::Ssd), Lines{"1e-06" + measured});
  EXPECT_THAT(said_of("regularisation", Model::Auto, SimilarityType::Lncc), IsEmpty());
  EXPECT_EQ(said_of("regularisation in use", Model::Auto, SimilarityType::Lncc, {{"regularisation", "0"}}),
            Lines{"0.0001" + measured});
  EXPECT_THAT(said_of("regularisation in use", Model::Auto, SimilarityType::Ssd, {{"regularisation", "0.001"}}),
              IsEmpty());
}

TEST(Choices, TellWhatIsAskedOfTheShearOfOrderZero) {
  const std::string measured = " (from the similarity, the dimension and the preset, for which it was measured)";
  EXPECT_EQ(said_of("first_order_shear", Model::Auto, SimilarityType::Mi), Lines{"5" + measured});
  EXPECT_EQ(said_of("first_order_shear", Model::Auto, SimilarityType::Lncc, {}, Preset::Fast), Lines{"12" + measured});
  EXPECT_EQ(said_of("first_order_shear", Model::Auto, SimilarityType::Lncc), Lines{"5" + measured});
  EXPECT_EQ(said_of("plain_shear", Model::Auto, SimilarityType::Ssd),
            Lines{"10 (by first_order_shear, where order 0 need not settle first: from the similarity, the dimension, "
                  "the preset and its weight beside first orders)"});
  EXPECT_EQ(said_of("settled_plain_shear", Model::Auto, SimilarityType::Lncc, {}, Preset::Balanced),
            Lines{"20" + measured});
  const std::string of_all =
      " (from the similarity, the dimension and the preset, for which it was measured, with one "
      "weight beside all slips (regularisation_beside_first))";
  EXPECT_EQ(said_of("first_order_shear", Model::Auto, SimilarityType::Lncc, {{"regularisation_beside_first", "0.0003"}},
                    Preset::Balanced),
            Lines{"12" + of_all});
}

TEST(Choices, TellOfWhichRangeTheNoiseIsUnlessTheJobGaveIt) {
  EXPECT_EQ(said_of("noise", Model::Auto, SimilarityType::Ssd),
            Lines{"1.5 % (measured in the images, of the fixed image's range)"});
  EXPECT_EQ(said_of("noise", Model::Auto, SimilarityType::Lncc),
            Lines{"1.5 % (measured in the images, of each one's own range)"});
  EXPECT_EQ(said_of("noise", Model::Auto, SimilarityType::Lncc, {{"noise", "0.015"}}),
            Lines{"0.015 (set by the job; the default is -1)"});
}

TEST(Choices, ListWhatWasSetAndWhatWasFilledIn) {
  ReportScene<3> scene(3);
  set_parameter(scene.options, "regularisation", "0.5");
  scene.result.options = resolved(scene.options, lattice_of(scene.images.fixed.grid));
  const auto all = choices(scene.report);
  EXPECT_THAT(all, Contains(AllOf(Field(&Choice::name, "regularisation"), Field(&Choice::value, "0.5"),
                                  Field(&Choice::is_set, true), Field(&Choice::why, HasSubstr("set by the job")))));
  EXPECT_THAT(all, Contains(AllOf(Field(&Choice::name, "levels"), Field(&Choice::is_set, false),
                                  Field(&Choice::why, HasSubstr("12x16x20")))));
  EXPECT_THAT(all, Contains(AllOf(Field(&Choice::name, "finest_level"), Field(&Choice::value, "2"),
                                  Field(&Choice::why, HasSubstr("preset fast")))));
  EXPECT_THAT(all, Not(Contains(Field(&Choice::name, "time_steps"))));
}

TEST(Choices, TellWhetherFirstOrderMomentaWereLetInAndWhy) {
  ReportScene<2> scene(3);
  const auto line = [&scene] { return choices(scene.report); };
  const auto named = Field(&Choice::name, "level 1: first-order momenta");
  EXPECT_THAT(line(), Not(Contains(named)));  // nobody asked
  LevelSummary& level = scene.result.summary.levels[0];
  scene.result.options.momenta.first_order_shear = 4.5;
  const auto is = [&](const char* value, const char* shear, const char* end) {
    return Contains(
        AllOf(named, Field(&Choice::value, value),
              Field(&Choice::why,
                    AllOf(HasSubstr("shear of its displacement, as it is or less what most of the image does, was " +
                                    std::string(shear) + " (asked: 4.5): "),
                          HasSubstr(std::string("): ") + end)))));
  };
  level.simple_shear = 12.5;
  level.decision = FirstOrderDecision::LetIn;
  EXPECT_THAT(line(), is("let in", "12.5", "something slides"));
  EXPECT_THAT(line(), Not(Contains(Field(&Choice::why, HasSubstr("beside them")))));
  RegistrationOptions::Momenta& momenta = scene.result.options.momenta;
  momenta.regularisation_beside_first = 0.125;
  EXPECT_THAT(line(), is("let in", "12.5", "something slides; regularisation is 0.125 beside them"));
  momenta.regularisation_beside_plain = 0.25;
  momenta.settled_plain_shear = 12.5;
  EXPECT_THAT(line(), is("let in", "12.5", "something slides; regularisation is 0.25 beside them (the slip is plain)"));
  momenta.settled_plain_shear = 12.75;
  EXPECT_THAT(line(),
              is("let in", "12.5", "something slides; regularisation is 0.125 beside them (the slip is not plain)"));
  const auto why = [&](const std::string& part) { return Contains(Field(&Choice::why, HasSubstr(part))); };
  level.quick_share = 0.875;
  EXPECT_THAT(line(), Not(why("ten iterations"))) << "nobody asked";
  momenta.quick_share = 0.75;
  level.gave_up_sharp = true;
  EXPECT_THAT(line(), why("(the slip is not plain); ten iterations had 88 % of what order 0 brought until it settled "
                          "(asked: 75 %): it gave up what was sharp, which it finds again as fast"));
  level.gave_up_sharp = false;
  EXPECT_THAT(line(), why("(asked: 75 %): it kept what it had found"));
  level.quick_share = -1;
  EXPECT_THAT(line(), Not(why("ten iterations")));
  EXPECT_THAT(line(), Not(why("quick")));
  EXPECT_THAT(line(), why("with order 0 settled the simple shear"));
  momenta.quick_tolerance = 0.25;
  level.quick_after = 9;
  level.gave_up_sharp = true;
  EXPECT_THAT(line(), why("with order 0 quick, after 9 iterations, the simple shear"));
  EXPECT_THAT(line(), why("(the slip is not plain); the last five iterations had at most 25 % of what order 0 had "
                          "brought: it gave up what was sharp, which it finds again as fast"));
  level.gave_up_sharp = false;
  EXPECT_THAT(line(), why("brought: it kept what it had found"));
  level.quick_after = -1;
  level.decision = FirstOrderDecision::LeftOut;
  EXPECT_THAT(line(), is("left out", "12.5", "something slides, but none"));
  level.simple_shear = 2.5;
  EXPECT_THAT(line(), is("left out", "2.5", "nothing slides"));
  level.decision = FirstOrderDecision::LetIn;
  level.simple_shear = 12.5;
  level.was_plain = true;
  scene.result.options.momenta.plain_shear = 9.5;
  EXPECT_THAT(
      line(),
      Contains(AllOf(
          named,
          Field(&Choice::why,
                HasSubstr("before order 0 had settled the simple shear "
                          "of its displacement, as it is or less what most of the image does, was 12.5 (asked: 9.5): "
                          "something slides; regularisation is "
                          "0.25 beside them (the slip is plain)")))));
  level.was_plain = false;
  level.has_finer = true;
  scene.result.options.momenta.finer_shear = 14.5;
  level.decision = FirstOrderDecision::LeftOut;
  EXPECT_THAT(
      line(),
      Contains(AllOf(named, Field(&Choice::why, HasSubstr("with order 0 settled on finer scales of its own the simple "
                                                          "shear of its displacement, as it is or less what most of "
                                                          "the image does, was 12.5 (asked: 14.5): nothing")))));
}

TEST(Choices, TellWhatNarrowWidthsCountAndWhy) {
  ReportScene<2> scene(3);
  const auto named = Field(&Choice::name, "level 1: narrow widths of order 0, alone");
  EXPECT_THAT(choices(scene.report), Not(Contains(named)));  // nobody asked
  LevelSummary& level = scene.result.summary.levels[0];
  scene.result.options.momenta.narrow_width_shear = 4.5;
  level.shear_before = 12.5;
  const auto because = [](const char* shear, const char* end) {
    return Field(&Choice::why, AllOf(HasSubstr(std::string("shear of ") + shear + " (asked: 4.5): "), HasSubstr(end)));
  };
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "as in kernel_widths"), because("12.5", "is sharp"))));
  level.shear_before = 3.5;
  level.narrow_share = 0.125;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "count 0.125 of that"), because("3.5", "is smooth"))));
}

TEST(Choices, TellWhetherOrder0GotANarrowerScaleAndWhy) {
  ReportScene<2> scene(3);
  const auto named = Field(&Choice::name, "level 1: a narrower scale of order 0, alone");
  EXPECT_THAT(choices(scene.report), Not(Contains(named)));  // nobody asked
  LevelSummary& level = scene.result.summary.levels[0];
  scene.result.options.momenta.first_order_shear = 5.5;
  level.simple_shear = 7.5;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "not asked"),
                             Field(&Choice::why, HasSubstr("was 7.5 (asked: less than 5.5): something slides")))));
  level.decision = FirstOrderDecision::LeftOut;  // that is told as what it is
  EXPECT_THAT(choices(scene.report), Not(Contains(named)));
  level.decision = FirstOrderDecision::None;
  scene.result.options.momenta.narrower_pull = 16.5;
  level.narrow_pull = 2.5;
  level.own_pull = 1.5;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "left out"),
                             Field(&Choice::why,
                                   AllOf(HasSubstr("was 2.5 times what noise"),
                                         HasSubstr("(asked: 16.5), and 1.5 times at its finest scale: too little"))))));
  scene.result.options.flow.map_tolerance = 0.5;
  const auto steps = Field(&Choice::why, HasSubstr("up to twice as many with the narrower scale"));
  EXPECT_THAT(choices(scene.report), Not(Contains(steps)));
  level.narrow_pull = 31.5;
  level.own_pull = 31.25;
  EXPECT_THAT(choices(scene.report), Contains(AllOf(named, Field(&Choice::value, "left out"),
                                                    Field(&Choice::why, HasSubstr("it is not the width")))));
  level.own_pull = 1.5;
  level.has_narrower = true;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "added"),
                             Field(&Choice::why, HasSubstr("1.5 times at its finest scale: there is detail")))));
  EXPECT_THAT(choices(scene.report), Contains(AllOf(Field(&Choice::name, "level 1: steps of the map"), steps)));
}

TEST(Choices, TellWhereTheImagesWereCompared) {
  ReportScene<2> scene(3);
  const auto named = Field(&Choice::name, "region");
  EXPECT_THAT(choices(scene.report), Not(Contains(named)));  // everywhere
  scene.result.summary.region = {{3, 17}, {0, 40}};
  scene.result.options.pyramid.region_margin = 5;
  EXPECT_THAT(choices(scene.report), Contains(AllOf(named, Field(&Choice::value, "3 to 16, 0 to 39"),
                                                    Field(&Choice::why, HasSubstr("in this box and 5 voxels")))));
}

TEST(Choices, TellHowManyStepsTheMapTookAndWhy) {
  ReportScene<2> scene(3);
  const auto named = Field(&Choice::name, "level 1: steps of the map");
  LevelSummary& level = scene.result.summary.levels[0];
  level.map_steps = 3;
  level.spacing_mm = 2;
  level.map_error_mm = 0.25;
  scene.result.options.flow.map_tolerance = 0;
  EXPECT_THAT(choices(scene.report), Not(Contains(named)));  // so many were asked for
  scene.result.options.flow.map_tolerance = 0.375;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "3"),
                             Field(&Choice::why, AllOf(HasSubstr("nothing was known"), HasSubstr("0.125 voxels"),
                                                       HasSubstr("(asked: 0.375)"))))));
  level.level = 2;
  level.map_steps = kMostMapSteps;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(Field(&Choice::name, "level 2: steps of the map"),
                             Field(&Choice::why, AllOf(HasSubstr("motion found before"), HasSubstr("at most 4"))))));
}

TEST(Choices, TellWhetherMomentaWereOrientedAndWhy) {
  ReportScene<2> scene(3);
  const auto named = Field(&Choice::name, "level 1: oriented momenta");
  LevelSummary& level = scene.result.summary.levels[0];
  level.oblique_share = 0.75;
  EXPECT_THAT(choices(scene.report), Not(Contains(named)));  // they were asked for, nothing was decided
  scene.options.momenta.oblique_share = -1;                  // by similarity and dimension: 0.5, or below always
  scene.result.options.momenta.oblique_share = 0.5;
  const auto because = Field(&Choice::why, AllOf(HasSubstr("75"), HasSubstr("oblique"), HasSubstr("asked: 50")));
  EXPECT_THAT(choices(scene.report), Contains(AllOf(named, Field(&Choice::value, "left out"), because)));
  level.oriented_elements = 17;
  EXPECT_THAT(choices(scene.report), Contains(AllOf(named, Field(&Choice::value, "17"), because)));
  scene.result.options.momenta.oblique_share = 0;
  EXPECT_THAT(choices(scene.report),
              Contains(AllOf(named, Field(&Choice::value, "17"), Field(&Choice::why, Not(HasSubstr("asked"))))));
  level.oriented_elements = 0;
  EXPECT_THAT(choices(scene.report), Contains(AllOf(named, Field(&Choice::value, "left out"),
                                                    Field(&Choice::why, "none of them wanted to join"))));
}

TEST(Choices, TellHowMuchOrderZeroIsHeldBesideFirstOrders) {
  const std::string from =
      " (from regularisation, by model, similarity, preset and dimension: how much of what is sharp is left to first "
      "orders)";
  const std::string of_plain =
      " (from regularisation, by model, similarity, preset and dimension: where a slip was plain (plain_shear, "
      "settled_plain_shear) it is all that is sharp)";
  const auto held = [](SimilarityType similarity, Preset preset) {
    Lines lines = said_of("regularisation_beside_first", Model::Auto, similarity, {}, preset);
    for (const std::string& line : said_of("regularisation_beside_plain", Model::Auto, similarity, {}, preset))
      lines.push_back(line);
    return lines;
  };
  for (Preset preset : {Preset::Balanced, Preset::Accurate})
    EXPECT_EQ(held(SimilarityType::Lncc, preset), (Lines{"0.0005" + from, "0.001" + of_plain}));
  EXPECT_EQ(held(SimilarityType::Ngf, Preset::Balanced), Lines{"0.003" + of_plain});
  EXPECT_EQ(held(SimilarityType::Mi, Preset::Balanced), Lines{"0.003" + from});
  EXPECT_EQ(held(SimilarityType::Mind, Preset::Balanced), (Lines{"0.0001" + from, "0.0002" + of_plain}));
  EXPECT_THAT(held(SimilarityType::Ncc, Preset::Balanced), IsEmpty());
}

TEST(Choices, MakeACommandThatAsksForTheSameAgain) {
  ReportScene<2> scene(3);
  set_parameter(scene.options, "regularisation", "0.5");
  scene.result.options = scene.options;
  EXPECT_EQ(command_line(scene.report),
            "saltus register --fixed FIXED --moving MOVING --out DIR --model sliding --similarity ssd --preset fast "
            "--affine rigid --set regularisation=0.5");
}

}  // namespace
}  // namespace saltus::report
