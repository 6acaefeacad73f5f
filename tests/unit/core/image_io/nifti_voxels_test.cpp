// What the voxels of a NIfTI file are worth, and which axes of them are read. The files are made here byte by byte; the
// oracle is the standard's formula, value = scl_slope * stored + scl_inter.
#include <gmock/gmock.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "core/image_io/output_stream.h"
#include "core/image_io/read_image.h"
#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

namespace saltus {
namespace {

using ::testing::HasSubstr;

constexpr std::int16_t kVector = 1007, kDisplacement = 1006, kMatrix = 1005, kPointSet = 1008;
constexpr std::int16_t kComplex = 32, kColour = 128, kComplexDouble = 1792, kColourAlpha = 2304;

template <typename Sample>
constexpr std::int16_t kDatatype = 0;
template <>
constexpr std::int16_t kDatatype<std::uint8_t> = 2;
template <>
constexpr std::int16_t kDatatype<std::int16_t> = 4;
template <>
constexpr std::int16_t kDatatype<std::int32_t> = 8;
template <>
constexpr std::int16_t kDatatype<float> = 16;
template <>
constexpr std::int16_t kDatatype<double> = 64;
template <>
constexpr std::int16_t kDatatype<std::int8_t> = 256;
template <>
constexpr std::int16_t kDatatype<std::uint16_t> = 512;
template <>
constexpr std::int16_t kDatatype<std::uint32_t> = 768;
template <>
constexpr std::int16_t kDatatype<std::int64_t> = 1024;
template <>
constexpr std::int16_t kDatatype<std::uint64_t> = 1280;

struct NiftiFile {
  std::vector<std::int16_t> size;  ///< of each axis that the header counts
  float slope = 1, intercept = 0;
  std::int16_t intent = 0;
  bool is_big_endian = false;

  template <typename Sample>
  std::string with(const std::vector<Sample>& stored) const {
    std::string bytes = with_datatype(kDatatype<Sample>, 8 * sizeof(Sample), "");
    for (const Sample one : stored) append(bytes, one);
    return bytes;
  }
  std::string with_datatype(std::int16_t datatype, std::int16_t bits, const std::string& stored) const {
    std::string bytes(352, '\0');
    put<std::int32_t>(bytes, 0, 348);
    put<std::int16_t>(bytes, 40, static_cast<std::int16_t>(size.size()));
    for (std::size_t axis = 0; axis < 7; ++axis)
      put<std::int16_t>(bytes, 42 + 2 * axis, axis < size.size() ? size[axis] : std::int16_t{1});
    put(bytes, 68, intent);
    put(bytes, 70, datatype);
    put(bytes, 72, bits);
    for (std::size_t axis = 0; axis < 8; ++axis) put<float>(bytes, 76 + 4 * axis, 1);
    put<float>(bytes, 108, 352);
    put(bytes, 112, slope);
    put(bytes, 116, intercept);
    put<std::int16_t>(bytes, 254, 1);  // an sform, of the axes of the world
    for (std::size_t axis = 0; axis < 3; ++axis) put<float>(bytes, 280 + 20 * axis, 1);
    bytes.replace(344, 3, "n+1");
    return bytes + stored;
  }

 private:
  template <typename Value>
  std::string as_stored(Value value) const {
    std::string bytes(sizeof value, '\0');
    std::memcpy(bytes.data(), &value, sizeof value);
    if (is_big_endian) std::reverse(bytes.begin(), bytes.end());
    return bytes;
  }
  template <typename Value>
  void put(std::string& bytes, std::size_t offset, Value value) const {
    bytes.replace(offset, sizeof value, as_stored(value));
  }
  template <typename Value>
  void append(std::string& bytes, Value value) const {
    bytes += as_stored(value);
  }
};

class NiftiVoxels : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    const bool is_packed = name.ends_with(".gz");
    OutputStream file(folder_ / name, is_packed ? OutputStream::Packing::Gzip : OutputStream::Packing::Plain, name);
    file.write(bytes);
    file.finish();
    return folder_ / name;
  }

  template <typename Sample>
  std::vector<float> samples_of(const std::string& name, const NiftiFile& file,
                                const std::vector<Sample>& stored) const {
    return read_volume<3>(write(name, file.with(stored))).samples;
  }

  /// What header and voxels are refused for; both readers must say the same.
  std::string error_for(const std::string& name, const std::string& bytes) const {
    const auto path = write(name, bytes);
    const std::string of_header = message_of([&] { read_grid<3>(path); });
    EXPECT_EQ(message_of([&] { read_volume<3>(path); }), of_header);
    EXPECT_EQ(message_of([&] { read_vector_volume<3>(path); }), of_header);
    const std::string prefix = "cannot read " + name + ": ";
    EXPECT_TRUE(of_header.starts_with(prefix)) << of_header;
    return of_header.substr(std::min(prefix.size(), of_header.size()));
  }

  template <typename Read>
  static std::string message_of(Read read) {
    try {
      read();
    } catch (const FileError& error) {
      return error.what();
    }
    return "no error";
  }

 private:
  testing_support::TemporaryFolder folder_;
};

const std::vector<std::string> kNames{"a.nii", "b.nii.gz"};

template <typename Sample>
class NiftiScaling : public NiftiVoxels {};
using StoredTypes = ::testing::Types<std::uint8_t, std::int8_t, std::uint16_t, std::int16_t, std::uint32_t,
                                     std::int32_t, std::uint64_t, std::int64_t, float, double>;
TYPED_TEST_SUITE(NiftiScaling, StoredTypes);

TYPED_TEST(NiftiScaling, EveryTypeIsScaledByTheSlopeAndShiftedByTheIntercept) {
  const std::vector<TypeParam> stored{0, 1, 2, 3, 50, 100, 126, 127};
  for (const std::string& name : kNames)
    for (const auto& [slope, intercept] :
         {std::pair{1.0F, 0.0F}, {2.0F, -1024.0F}, {1.0F, -1024.0F}, {0.5F, 0.0F}, {-3.0F, 7.0F}})
      for (const bool is_big_endian : {false, true}) {
        std::vector<float> expected;
        for (const TypeParam one : stored) expected.push_back(slope * static_cast<float>(one) + intercept);
        EXPECT_EQ(this->samples_of(name, {{2, 2, 2}, slope, intercept, 0, is_big_endian}, stored), expected)
            << name << ' ' << slope << ' ' << intercept << (is_big_endian ? " big endian" : "");
      }
}

TYPED_TEST(NiftiScaling, EveryComponentIsScaled) {
  // One component after the other.
  const std::vector<TypeParam> stored{1, 2, 3, 4, 11, 12, 13, 14, 101, 102, 103, 104};
  for (const std::string& name : kNames) {
    const NiftiFile file{{2, 2, 1, 1, 3}, 2, -24, kVector};
    EXPECT_EQ(read_vector_volume<3>(this->write(name, file.with(stored))).samples,
              (std::vector<float>{-22, -20, -18, -16, -2, 0, 2, 4, 178, 180, 182, 184}));
  }
}

TYPED_TEST(NiftiScaling, AByteTooFewIsRefused) {
  const NiftiFile file{{2, 2, 2}, 2, -1024};
  const std::string bytes = file.with(std::vector<TypeParam>(8, TypeParam{3}));
  const std::string cut = bytes.substr(0, bytes.size() - 1);
  EXPECT_EQ(this->error_for("a.nii", cut), "its header promises 2x2x2 voxels, more than its " +
                                               std::to_string(cut.size()) +
                                               " bytes can hold; it is cut off or damaged");
  EXPECT_EQ(this->message_of([&] { read_volume<3>(this->write("b.nii.gz", cut)); }),
            "cannot read b.nii.gz: its compressed voxels break off; it is cut off or damaged");
}

TEST_F(NiftiVoxels, ASlopeOfZeroOrNoNumberLeavesThemAsTheyAre) {
  const float nothing = std::numeric_limits<float>::quiet_NaN();
  for (const std::string& name : kNames)
    for (const auto& [slope, intercept] :
         {std::pair{0.0F, 0.0F}, {0.0F, -1024.0F}, {0.0F, nothing}, {nothing, nothing}, {nothing, 3.0F}})
      EXPECT_EQ(samples_of<std::int16_t>(name, {{2, 2, 1}, slope, intercept}, {-1, 0, 7, 1000}),
                (std::vector<float>{-1, 0, 7, 1000}))
          << name << ' ' << slope << ' ' << intercept;
}

TEST_F(NiftiVoxels, ScalingThatIsNotFiniteIsRefused) {
  const float infinity = std::numeric_limits<float>::infinity(), nothing = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::int16_t> stored(4);
  EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, 1}, infinity, 0}.with(stored)),
            "its scl_slope is inf and its scl_inter 0.000000; both must be finite numbers");
  EXPECT_EQ(error_for("b.nii.gz", NiftiFile{{2, 2, 1}, 2, nothing}.with(stored)),
            "its scl_slope is 2.000000 and its scl_inter nan; both must be finite numbers");
}

// A float has 24 bits: stored numbers made floats first would leave nothing of these.
TEST_F(NiftiVoxels, AreScaledBeforeTheyAreRounded) {
  EXPECT_EQ(samples_of<std::int32_t>("a.nii", {{2, 2, 1}, 1, -2e9F}, {2000000000, 2000000001, 2000000003, 1999999999}),
            (std::vector<float>{0, 1, 3, -1}));
}

// The library looks for the voxels of a.nii.gz in a.nii first.
TEST_F(NiftiVoxels, AreThoseOfTheFileThatIsNamed) {
  const NiftiFile file{{2, 2, 1}};
  const auto plain = write("a.nii", file.with<std::int16_t>({1, 2, 3, 4}));
  const auto packed = write("a.nii.gz", file.with<std::int16_t>({5, 6, 7, 8}));
  EXPECT_EQ(read_volume<3>(plain).samples, (std::vector<float>{1, 2, 3, 4}));
  EXPECT_EQ(read_volume<3>(packed).samples, (std::vector<float>{5, 6, 7, 8}));
  write("a.nii", "no image");
  EXPECT_EQ(read_volume<3>(packed).samples, (std::vector<float>{5, 6, 7, 8}));
  write("B.NII", file.with<std::int16_t>({1, 2, 3, 4}));
  std::filesystem::rename(packed, packed.parent_path() / "B.NII.GZ");
  EXPECT_EQ(read_volume<3>(packed.parent_path() / "B.NII.GZ").samples, (std::vector<float>{5, 6, 7, 8}));
}

TEST_F(NiftiVoxels, ScaledLabelsAreWholeNumbers) {
  for (const std::string& name : kNames) {
    EXPECT_EQ(samples_of<std::uint8_t>(name, {{2, 2, 1}, 0.1F}, {0, 10, 20, 250}), (std::vector<float>{0, 1, 2, 25}));
    EXPECT_EQ(samples_of<std::uint8_t>(name, {{2, 2, 1}, 1.0F / 255}, {0, 255, 0, 255}),
              (std::vector<float>{0, 1, 0, 1}));
  }
}

TEST_F(NiftiVoxels, AFifthAxisIsRefusedUnlessTheIntentIsAVector) {
  const std::string end = "; use a 2-D or 3-D image, or give a vector image the intent code 1007";
  for (const std::string& name : kNames)
    for (const std::int16_t intent : {std::int16_t{0}, kDisplacement, kMatrix, kPointSet}) {
      // Large, so that voxels that have no room would hit something.
      const NiftiFile file{{40, 36, 24, 1, 3}, 1, 0, intent};
      const std::string sentence = "it has 3 values on axis 5 where its intent code is " + std::to_string(intent) + end;
      EXPECT_EQ(error_for(name, file.with(std::vector<std::int16_t>(3 * 40 * 36 * 24, 1))), sentence);
      EXPECT_EQ(error_for(name, file.with(std::vector<float>(3 * 40 * 36 * 24, 1))), sentence);
    }
  EXPECT_EQ(error_for("a.nii", NiftiFile{{4, 4, 1, 1, 2}}.with(std::vector<float>(32))),
            "it has 2 values on axis 5 where its intent code is 0" + end);
}

TEST_F(NiftiVoxels, AxesThatAreNotOfSpaceAreRefused) {
  const std::vector<std::int16_t> stored(48);
  EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, 2, 2}}.with(stored)),
            "it has 4 dimensions (2x2x2x2); use a 2-D or 3-D image");
  EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, 1, 2, 1}}.with(stored)),
            "it has 4 dimensions (2x2x1x2); use a 2-D or 3-D image");
  EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, 2, 2, 3}, 1, 0, kVector}.with(stored)),
            "it has 4 dimensions (2x2x2x2); use a 2-D or 3-D image");
  for (const std::int16_t intent : {std::int16_t{0}, kVector}) {
    EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, 2, 1, 1, 3}, 1, 0, intent}.with(stored)),
              "it has 3 values on axis 6; use a 2-D or 3-D image");
    EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, 2, 1, 1, 1, 3}, 1, 0, intent}.with(stored)),
              "it has 3 values on axis 7; use a 2-D or 3-D image");
  }
}

TEST_F(NiftiVoxels, AxesWithoutVoxelsAreRefused) {
  const std::vector<std::int16_t> stored(16);
  for (const std::int16_t none : {0, -2}) {
    EXPECT_EQ(error_for("a.nii", NiftiFile{{none, 2, 2}}.with(stored)),
              "its size on axis 1 is " + std::to_string(none) + "; it must be at least 1");
    EXPECT_EQ(error_for("a.nii", NiftiFile{{2, none, 2}}.with(stored)),
              "its size on axis 2 is " + std::to_string(none) + "; it must be at least 1");
    EXPECT_EQ(error_for("a.nii", NiftiFile{{2, 2, none, 1, 2}, 1, 0, kVector}.with(stored)),
              "its size on axis 3 is " + std::to_string(none) + "; it must be at least 1");
  }
  for (const std::size_t axis : {4, 5, 6, 7}) {
    NiftiFile file{{2, 2, 2, 1, 1, 1, 1}};
    file.size[axis - 1] = -3;
    EXPECT_EQ(error_for("a.nii", file.with(stored)),
              "its size on axis " + std::to_string(axis) + " is -3; it must be at least 0");
  }
}

TEST_F(NiftiVoxels, AxesOfOneVoxelOrNoneBeyondTheThirdCountForNothing) {
  const std::vector<std::int16_t> stored{1, 2, 3, 4, 5, 6, 7, 8};
  const std::vector<float> expected(stored.begin(), stored.end());
  for (const std::int16_t one : {1, 0})
    for (std::size_t axes = 3; axes <= 7; ++axes)
      for (const std::int16_t intent : {std::int16_t{0}, kVector}) {
        NiftiFile file{{2, 2, 2}, 1, 0, intent};
        file.size.resize(axes, one);
        EXPECT_EQ(samples_of("a.nii", file, stored), expected) << axes << " axes of " << one << ", intent " << intent;
      }
}

TEST_F(NiftiVoxels, FlatImagesAndFieldsAreRead) {
  const std::vector<std::int16_t> stored{1, 2, 3, 4, 5, 6, 7, 8};
  EXPECT_EQ(read_volume<2>(write("a.nii", NiftiFile{{2, 4}, 2, 1}.with(stored))).samples,
            (std::vector<float>{3, 5, 7, 9, 11, 13, 15, 17}));
  EXPECT_EQ(read_vector_volume<2>(write("a.nii", NiftiFile{{2, 2, 1, 1, 2}, 2, 1, kVector}.with(stored))).samples,
            (std::vector<float>{3, 5, 7, 9, 11, 13, 15, 17}));
}

TEST_F(NiftiVoxels, VectorsAndMatricesOfWhatIsNoRealNumberAreRefused) {
  const std::pair<std::int16_t, std::int16_t> types[] = {
      {kComplex, 64}, {kColour, 24}, {kComplexDouble, 128}, {kColourAlpha, 32}};
  for (const auto& [datatype, bits] : types) {
    const std::string sentence =
        "its data type " + std::to_string(datatype) +
        " is not one of real numbers, as its intent code 1007 needs; save its components as float";
    for (const std::int16_t components : {1, 3})
      EXPECT_EQ(error_for("a.nii", NiftiFile{{8, 8, 8, 1, components}, 1, 0, kVector}.with_datatype(
                                       datatype, bits, std::string(512 * 3 * bits / 8, '\1'))),
                sentence);
    EXPECT_THAT(error_for("a.nii", NiftiFile{{8, 8, 8}, 1, 0, kMatrix}.with_datatype(
                                       datatype, bits, std::string(512 * bits / 8, '\1'))),
                HasSubstr("as its intent code 1005 needs"));
  }
}

// The standard: scaling is to be ignored for colours.
TEST_F(NiftiVoxels, ColoursAreNotScaled) {
  const std::string colours("\1\2\3\4\5\6\7\10\11\12\13\14", 12);
  const auto path = write("b.nii.gz", NiftiFile{{2, 2, 1}, 2, -1024}.with_datatype(kColour, 24, colours));
  EXPECT_EQ(read_vector_volume<3>(path).samples, (std::vector<float>{1, 4, 7, 10, 2, 5, 8, 11, 3, 6, 9, 12}));
}

}  // namespace
}  // namespace saltus
