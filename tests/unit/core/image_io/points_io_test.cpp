#include "core/image_io/points_io.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "core/support/errors.h"

namespace saltus {
namespace {

class PointsIo : public ::testing::Test {
 protected:
  PointsIo()
      : path_(std::filesystem::path(::testing::TempDir()) / ("saltus-points-" + std::to_string(getpid()) + ".csv")) {}
  ~PointsIo() override { std::filesystem::remove(path_); }

  void write_text(const std::string& text) const { std::ofstream(path_, std::ios::binary) << text; }

  template <int Dim>
  std::string error_for(const std::string& text) const {
    write_text(text);
    try {
      read_points<Dim>(path_);
    } catch (const FileError& error) {
      const std::string message = error.what();
      const std::string prefix = "cannot read " + path_.filename().string() + ": ";
      EXPECT_TRUE(message.starts_with(prefix)) << message;
      return message.substr(prefix.size());
    }
    return "no error";
  }

  std::filesystem::path path_;
};

TEST_F(PointsIo, WhatIsWrittenReadsBackExactly) {
  const std::vector<Vector<3>> points{{0.1, -1.0 / 3, 1e-17}, {12345.678901234567, 0, -2e20}};
  write_points<3>(path_, points);
  EXPECT_EQ(read_points<3>(path_), points);
  const std::vector<Vector<2>> flat{{0.1, 1.0 / 7}};
  write_points<2>(path_, flat);
  EXPECT_EQ(read_points<2>(path_), flat);
}

TEST_F(PointsIo, ReadsWhatOtherProgramsWrite) {
  write_text("\xEF\xBB\xBFx, y, z\r\n 1.5 ,\t-2e1,+3\r\n\r\n4,5,6");
  EXPECT_EQ(read_points<3>(path_), (std::vector<Vector<3>>{{1.5, -20, 3}, {4, 5, 6}}));
}

TEST_F(PointsIo, FlatReadTakesThreeColumnsOnlyWhenZIsZero) {
  write_text("x,y,z\n1,2,0\n3,4,-0.0\n");
  EXPECT_EQ(read_points<2>(path_), (std::vector<Vector<2>>{{1, 2}, {3, 4}}));
  EXPECT_EQ(error_for<2>("x,y,z\n1,2,0\n3,4,0.5\n"),
            "line 3 has z = 0.5; points of 2-D images need z = 0, or the header x,y");
}

TEST_F(PointsIo, ErrorsNameLineAndReason) {
  EXPECT_EQ(error_for<3>("x,y,z\n1,2,3\n1,2\n"), "line 3 has 2 fields; the header has 3");
  EXPECT_EQ(error_for<3>("x,y,z\n1,nan,3\n"), "line 2 has 'nan' where a finite number is needed");
  EXPECT_EQ(error_for<3>("x,y,z\n1,inf,3\n"), "line 2 has 'inf' where a finite number is needed");
  EXPECT_EQ(error_for<3>("x,y,z\n1,2mm,3\n"), "line 2 has '2mm' where a finite number is needed");
  EXPECT_EQ(error_for<3>("x,y,z\n1,,3\n"), "line 2 has '' where a finite number is needed");
  EXPECT_EQ(error_for<3>("x,y,z\n1,1e999,3\n"), "line 2 has '1e999' where a finite number is needed");
  EXPECT_EQ(error_for<3>("1,2,3\n"), "line 1 is '1,2,3'; the first line must be x,y,z");
  EXPECT_EQ(error_for<3>("x,y\n1,2\n"), "line 1 is 'x,y'; the first line must be x,y,z");
  EXPECT_EQ(error_for<2>("y,x\n1,2\n"), "line 1 is 'y,x'; the first line must be x,y");
  EXPECT_EQ(error_for<3>("x,y,z\n"), "it has a header but no points");
  EXPECT_EQ(error_for<3>(""), "it is empty");
  EXPECT_THROW(read_points<3>(path_.string() + ".absent"), FileError);
}

TEST_F(PointsIo, RefusesToWriteWhatIsNotFinite) {
  EXPECT_THROW(write_points<2>(path_, {{0, std::numeric_limits<double>::quiet_NaN()}}), InvalidInput);
  EXPECT_FALSE(std::filesystem::exists(path_));
}

}  // namespace
}  // namespace saltus
