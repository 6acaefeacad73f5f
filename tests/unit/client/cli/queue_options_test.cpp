#include "client/cli/queue_options.h"

#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/support/blob_pair.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <CLI/CLI.hpp>

namespace saltus::cli {
namespace {

using testing::HasSubstr;

class QueueOptionsTest : public testing::Test {
 protected:
  QueueOptionsTest() {
    write_volume(folder / "fixed.mha", testing_support::blob_scene(32, 0));
    write_volume(folder / "moving.mha", testing_support::blob_scene(32, 1));
    write_volume(folder / "large.mha", testing_support::blob_scene(128, 0));
    job.fixed = folder / "fixed.mha";
    job.moving = folder / "moving.mha";
  }
  /// What the command line makes of `words`.
  static QueueOptions parsed(std::vector<std::string> words) {
    CLI::App app;
    QueueOptions options;
    add_queue_options(app, options);
    std::reverse(words.begin(), words.end());
    app.parse(words);
    return options;
  }
  v1::CreateRegistrationJobRequest request(const std::vector<std::string>& words) const {
    return make_request(parsed(words), job);
  }
  std::string complaint(const QueueOptions& options) const {
    try {
      make_request(options, job);
    } catch (const InvalidInput& error) {
      return error.what();
    }
    return "";
  }

  testing_support::TemporaryFolder folder;
  JobOptions job;
};

TEST_F(QueueOptionsTest, WhatIsNotSaidIsNormalAndHasNoLimit) {
  const auto made = request({});
  EXPECT_EQ(made.priority(), v1::JOB_PRIORITY_NORMAL);
  EXPECT_TRUE(made.labels().empty());
  EXPECT_EQ(made.resources().memory_bytes_limit(), 0);
  EXPECT_EQ(made.resources().wall_seconds_limit(), 0);
  EXPECT_EQ(made.resources().cpu_seconds_limit(), 0);
  EXPECT_FALSE(made.has_spec()) << "which is made of the job's own options";
}

TEST_F(QueueOptionsTest, CarriesWhatTheCommandLineSaysInTheUnitsOfTheProtocol) {
  const auto made = request({"--priority", "high", "--label", "case=7", "--label", "note=a=b", "--memory", "1.5",
                             "--memory-limit", "2", "--wall-time", "1.5", "--cpu-time", "0.001"});
  EXPECT_EQ(made.priority(), v1::JOB_PRIORITY_HIGH);
  EXPECT_EQ(made.labels_size(), 2);
  EXPECT_EQ(made.labels().at("case"), "7");
  EXPECT_EQ(made.labels().at("note"), "a=b") << "only the first sign divides";
  EXPECT_EQ(made.resources().memory_bytes(), 3 * (std::int64_t{1} << 29));
  EXPECT_EQ(made.resources().memory_bytes_limit(), std::int64_t{2} << 30);
  EXPECT_EQ(made.resources().wall_seconds_limit(), 90);
  EXPECT_EQ(made.resources().cpu_seconds_limit(), 1) << "0 would be no limit";
  EXPECT_EQ(request({"--priority", "low"}).priority(), v1::JOB_PRIORITY_LOW);
}

TEST_F(QueueOptionsTest, EstimatesMemoryFromTheImagesAndTheCrop) {
  const std::int64_t small = request({}).resources().memory_bytes();
  EXPECT_GT(small, 32 * 32 * 4);
  job.fixed = folder / "large.mha";
  const std::int64_t large = request({}).resources().memory_bytes();
  EXPECT_GT(large, small);
  job.crop = "0,0:32,32";
  const std::int64_t cropped = request({}).resources().memory_bytes();
  EXPECT_LT(cropped, large);
}

TEST_F(QueueOptionsTest, NamesWhatCannotBeUsed) {
  EXPECT_THAT(complaint({.priority = "urgent"}), HasSubstr("--priority is urgent; it must be low, normal or high"));
  EXPECT_THAT(complaint({.labels = {"case"}}), HasSubstr("--label is case; it must be NAME=VALUE"));
  EXPECT_THAT(complaint({.labels = {"=7"}}), HasSubstr("--label is =7"));
  EXPECT_THAT(complaint({.labels = {"case=7", "case=8"}}), HasSubstr("--label is case=8 beside another of that name"));
  for (const char* option : {"--memory", "--memory-limit", "--wall-time", "--cpu-time"})
    EXPECT_THROW(parsed({option, "-1"}), CLI::ParseError) << option;
  EXPECT_THAT(parse_labels({"case=", "side=left"}),
              testing::ElementsAre(std::pair("case", ""), std::pair("side", "left")));
}

}  // namespace
}  // namespace saltus::cli
