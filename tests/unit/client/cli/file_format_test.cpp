#include "client/cli/file_format.h"

#include "core/support/errors.h"

#include <gmock/gmock.h>

namespace saltus::cli {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

TEST(ImageFormat, IsRecognisedByTheEndOfTheName) {
  EXPECT_EQ(image_format("--fixed", "a.mha"), "mha");
  EXPECT_EQ(image_format("--fixed", "a.nii"), "nii");
  EXPECT_EQ(image_format("--fixed", "folder.png/a.b.nii.gz"), "nii.gz");
  EXPECT_EQ(image_format("--fixed", "A.NII.GZ"), "nii.gz");
  EXPECT_EQ(image_format("--fixed", "a.nrrd"), "nrrd");
  EXPECT_EQ(image_format("--fixed", "a.png"), "png");
}

TEST(ImageFormat, NamesOptionFileAndSuffixesWhenUnknown) {
  for (const char* file : {"a.dcm", "a.gz", "a.mhd", "mha", "a.mha.txt"})
    EXPECT_THAT(
        [file] { image_format("--moving", file); },
        ThrowsMessage<InvalidInput>(testing::AllOf(HasSubstr("--moving"), HasSubstr(file), HasSubstr(".nii.gz"))))
        << file;
}

TEST(PointsFormat, IsCsvAlone) {
  EXPECT_EQ(points_format("--fixed-points", "p.csv"), "csv");
  EXPECT_THAT([] { points_format("--fixed-points", "p.txt"); }, ThrowsMessage<InvalidInput>(HasSubstr(".csv")));
}

}  // namespace
}  // namespace saltus::cli
