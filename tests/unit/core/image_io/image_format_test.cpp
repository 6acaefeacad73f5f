#include "core/image_io/image_format.h"

#include <gtest/gtest.h>

#include "core/support/errors.h"

namespace saltus {
namespace {

TEST(ImageFormat, ComesFromTheEndOfTheName) {
  EXPECT_EQ(format_from_suffix("a.mha"), ImageFormat::MetaImage);
  EXPECT_EQ(format_from_suffix("folder.png/a.nii"), ImageFormat::Nifti);
  EXPECT_EQ(format_from_suffix("a.b.nii.gz"), ImageFormat::CompressedNifti);
  EXPECT_EQ(format_from_suffix("A.NRRD"), ImageFormat::Nrrd);
  EXPECT_EQ(format_from_suffix("a.Png"), ImageFormat::Png);
}

TEST(ImageFormat, RefusesOthersAndListsThese) {
  for (const char* name : {"a.mhd", "a.nhdr", "a.hdr", "a.img", "a.gz", "a", "", "a.mha.txt", "mha"})
    EXPECT_THROW(format_from_suffix(name), InvalidInput) << name;
  try {
    format_from_suffix("/home/somebody/scan.dcm");
    FAIL();
  } catch (const InvalidInput& error) {
    EXPECT_STREQ(error.what(),
                 "image format of 'scan.dcm' is not known; use a name that ends in .mha, .nii, .nii.gz, .nrrd or .png");
  }
}

}  // namespace
}  // namespace saltus
