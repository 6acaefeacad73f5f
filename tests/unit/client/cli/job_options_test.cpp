#include "client/cli/job_options.h"

#include "core/support/errors.h"

#include <gmock/gmock.h>

namespace saltus::cli {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;

JobOptions two_images() {
  JobOptions options;
  options.fixed = "fixed.mha";
  options.moving = "moving.nii.gz";
  return options;
}

TEST(IntensityWindow, IsTwoNumbersInOrder) {
  EXPECT_EQ(parse_intensity_window("-1000,400"), std::make_pair(-1000.0, 400.0));
  EXPECT_EQ(parse_intensity_window("0.5,1e3"), std::make_pair(0.5, 1000.0));
  for (const char* text : {"", "1", "1,2,3", "2,1", "1,1", "a,b", "1,nan", "-inf,1", "1,2 ", "1,"})
    EXPECT_THROW(parse_intensity_window(text), InvalidInput) << text;
}

TEST(Crop, IsABoxOfTwoOrThreeDimensions) {
  const Box flat = parse_crop("1,2:30,40");
  EXPECT_THAT(flat.begin, ElementsAre(1, 2));
  EXPECT_THAT(flat.end, ElementsAre(30, 40));
  EXPECT_THAT(parse_crop("0,0,5:10,10,6").end, ElementsAre(10, 10, 6));
  for (const char* text : {"", "1,2", "1:2", "1,2:3", "1,2:3,4,5", "1,2,3,4:5,6,7,8", "5,5:5,9", "-1,0:5,5", "a,0:5,5",
                           "1,2:3,4:5,6", "1.5,0:4,4", "0,0,:4,4,4"})
    EXPECT_THROW(parse_crop(text), InvalidInput) << text;
}

TEST(MakeSpec, CarriesWhatTheCommandLineSays) {
  JobOptions options = two_images();
  options.moving_mask = "mask.nrrd";
  options.fixed_points = "p.csv";
  options.moving_points = "q.csv";
  options.model = "wendland1";
  options.similarity = "ssd";
  options.preset = "fast";
  options.affine = "rigid";
  options.intensity_window = "-1000,400";
  options.crop = "1,2,3:4,5,6";
  options.settings = {"time_steps=7", "levels=2"};
  options.format = "mha";
  options.threads = 3;
  const v1::RegistrationSpec spec = make_spec(options);
  EXPECT_EQ(spec.fixed().format(), "mha");
  EXPECT_EQ(spec.moving().format(), "nii.gz");
  EXPECT_FALSE(spec.has_fixed_mask());
  EXPECT_EQ(spec.moving_mask().format(), "nrrd");
  EXPECT_EQ(spec.fixed_points().format(), "csv");
  EXPECT_EQ(spec.model(), "wendland1");
  EXPECT_EQ(spec.similarity(), "ssd");
  EXPECT_EQ(spec.preset(), "fast");
  EXPECT_EQ(spec.affine(), v1::AFFINE_START_RIGID);
  EXPECT_EQ(spec.intensity_window().low(), -1000);
  EXPECT_EQ(spec.intensity_window().high(), 400);
  EXPECT_THAT(spec.crop().begin(), ElementsAre(1, 2, 3));
  EXPECT_THAT(spec.crop().end(), ElementsAre(4, 5, 6));
  EXPECT_EQ(spec.settings().at("time_steps"), "7");
  EXPECT_EQ(spec.settings().at("levels"), "2");
  EXPECT_EQ(spec.output_format(), "mha");
  EXPECT_EQ(spec.threads(), 3);
}

struct BadOption {
  const char* text;  ///< must be in the message
  std::function<void(JobOptions&)> spoil;
};

class MakeSpecRefuses : public testing::TestWithParam<BadOption> {};

TEST_P(MakeSpecRefuses, AndNamesTheCulprit) {
  JobOptions options = two_images();
  GetParam().spoil(options);
  EXPECT_THAT([&] { make_spec(options); }, ThrowsMessage<InvalidInput>(HasSubstr(GetParam().text)));
}

INSTANTIATE_TEST_SUITE_P(BadOptions, MakeSpecRefuses,
                         testing::Values(BadOption{"--fixed", [](JobOptions& o) { o.fixed.clear(); }},
                                         BadOption{"--moving", [](JobOptions& o) { o.moving.clear(); }},
                                         BadOption{".nrrd", [](JobOptions& o) { o.fixed = "a.dcm"; }},
                                         BadOption{"--moving-mask", [](JobOptions& o) { o.moving_mask = "a.jpg"; }},
                                         BadOption{"demons", [](JobOptions& o) { o.model = "demons"; }},
                                         BadOption{"mse", [](JobOptions& o) { o.similarity = "mse"; }},
                                         BadOption{"quick", [](JobOptions& o) { o.preset = "quick"; }},
                                         BadOption{"--affine", [](JobOptions& o) { o.affine = "similarity"; }},
                                         BadOption{"--format", [](JobOptions& o) { o.format = "png"; }},
                                         BadOption{"both or none", [](JobOptions& o) { o.fixed_points = "p.csv"; }},
                                         BadOption{"NAME=VALUE", [](JobOptions& o) { o.settings = {"time_steps"}; }},
                                         BadOption{"step_times", [](JobOptions& o) { o.settings = {"step_times=3"}; }},
                                         BadOption{"time_steps",
                                                   [](JobOptions& o) { o.settings = {"time_steps=0"}; }}));

TEST(ParameterTable, ListsEveryParameterOfTheChosenModel) {
  JobOptions options;
  EXPECT_FALSE(wants_parameter_help(options));
  options.settings = {"help"};
  EXPECT_TRUE(wants_parameter_help(options));
  const std::string table = parameter_table(options);
  EXPECT_THAT(table, HasSubstr("time_steps"));
  EXPECT_THAT(table, HasSubstr("description"));
  EXPECT_EQ(table.find("\n\n"), std::string::npos);
}

}  // namespace
}  // namespace saltus::cli
