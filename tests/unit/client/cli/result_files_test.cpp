#include "client/cli/result_files.h"

#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>

#include <filesystem>

namespace saltus::cli {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class ResultFiles : public testing::Test {
 protected:
  /// Names of what is outdated once the folder has, beside `there`, the files `names` of a new result.
  std::vector<std::string> outdated(const std::vector<std::string>& there, const std::vector<std::string>& names) {
    for (const std::string& name : there) folder.write(name, "x");
    for (const std::string& name : names) folder.write(name, "x");
    std::vector<std::string> found;
    for (const auto& file : outdated_files(folder.path(), names)) {
      EXPECT_EQ(file.parent_path(), folder.path());
      found.push_back(file.filename());
    }
    return found;
  }
  testing_support::TemporaryFolder folder;
};

TEST_F(ResultFiles, OfOtherFormatsAreOutdated) {
  EXPECT_THAT(outdated({"displacement.mha", "displacement.nrrd", "warped.mha"},
                       {"displacement.nii.gz", "warped.nii.gz", "transform.h5", "report.json"}),
              ElementsAre("displacement.mha", "displacement.nrrd", "warped.mha"));
}

TEST_F(ResultFiles, MomentaOfScalesThatAreNoMoreAreOutdated) {
  EXPECT_THAT(outdated({"momentum_2_order1_x.mha", "momentum_3_order1_oriented.mha", "momentum_10_order0.nrrd"},
                       {"displacement.mha", "momentum_1_order0.mha", "momentum_2_order1_y.mha"}),
              ElementsAre("momentum_10_order0.nrrd", "momentum_2_order1_x.mha", "momentum_3_order1_oriented.mha"));
}

TEST_F(ResultFiles, WhatNoRegistrationWritesStays) {
  std::filesystem::create_directory(folder / "displacement.nrrd");
  folder.write("elsewhere.mha", "x");
  std::filesystem::create_symlink("elsewhere.mha", folder / "warped.nrrd");
  EXPECT_THAT(outdated({"displacement.nii", "displacement.mha.bak", "displacement_before.nrrd", "momentum_2.mha",
                        "momentum_2_order1_w.mha", "momentum_02_order0.mha", "my_momentum_2_order0.mha",
                        "jacobian.nrrd", "report.txt", "labels.nrrd"},
                       {"displacement.mha", "warped.mha", "momentum_1_order0.mha", "report.json"}),
              IsEmpty());
}

TEST_F(ResultFiles, MomentaStayWhereTheNewFilesAreNoRegistration) {
  EXPECT_THAT(outdated({"momentum_2_order0.mha"}, {"log.txt", "warped.mha"}), IsEmpty());
}

TEST_F(ResultFiles, InputsAreNoResults) {
  std::filesystem::create_directory(folder / "out");
  const auto warped = folder.write("out/warped.mha", "x"), own = folder.write("out/ct.mha", "x");
  std::filesystem::create_symlink(warped, folder / "link.mha");
  for (const std::filesystem::path& input : {warped, folder / "link.mha"})
    EXPECT_THROW(refuse_input_among_results("--moving", input, folder / "out"), InvalidInput) << input;
  EXPECT_NO_THROW(refuse_input_among_results("--moving", own, folder / "out"));
  EXPECT_NO_THROW(refuse_input_among_results("--moving", warped, folder / "elsewhere"));
  EXPECT_NO_THROW(refuse_input_among_results("--moving", folder / "nothing.mha", folder / "out"));
}

TEST_F(ResultFiles, OnlyAListsMarkIsOne) {
  EXPECT_FALSE(is_marked_done(folder.path()));
  for (const char* other : {"no JSON", "{\"mine\": 1}", "{\"request\": 1}", "{\"request\": \"a\", \"mine\": 1}"}) {
    folder.write(done_file, other);
    EXPECT_FALSE(is_marked_done(folder.path())) << other;
  }
  folder.write(done_file, "{\"request\": \"sha256:1\"}\n");
  EXPECT_TRUE(is_marked_done(folder.path()));
}

TEST_F(ResultFiles, AResultIsKnownByItsReport) {
  EXPECT_FALSE(holds_result(folder.path()));
  for (const char* other : {"no JSON", "[1]", "{}", "{\"program\": 1}", "{\"program\": \"elastix 5\"}"}) {
    folder.write("report.json", other);
    EXPECT_FALSE(holds_result(folder.path())) << other;
  }
  folder.write("report.json", "{\"program\": \"saltus 0.1.0\"}");
  EXPECT_TRUE(holds_result(folder.path()));
}

}  // namespace
}  // namespace saltus::cli
