// Damaged, hostile and ambiguous files, made here byte by byte.
#include <gmock/gmock.h>
#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>

#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/integration/image_io/nifti_bytes.h"
#include "tests/integration/image_io/sample_images.h"
#include "tests/support/guarded_child.h"

namespace saltus {
namespace {

using testing::expect_same_place;
using testing::NiftiBytes;
using testing::oblique_grid;
using testing::read_bytes;
using testing::sample_vectors;
using testing::sample_volume;
using testing::TemporaryFolder;
using testing::write_bytes;

template <int Dim = 3>
std::string error_for(const std::filesystem::path& path) {
  try {
    read_volume<Dim>(path);
  } catch (const FileError& error) {
    const std::string message = error.what();
    EXPECT_TRUE(message.starts_with("cannot read " + path.filename().string() + ": ")) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    EXPECT_EQ(message.find(path.parent_path().string()), std::string::npos) << "leaks the folder: " << message;
    return message;
  }
  return "no error";
}

std::string meta_header(const std::string& size, const std::string& data_file, const std::string& more = "") {
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n" +
         more + "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nElementSpacing = 1 1 1\nDimSize = " + size +
         "\nElementType = MET_UCHAR\nElementDataFile = " + data_file + "\n";
}

std::string nrrd_header(const std::string& sizes, const std::string& more, const std::string& encoding = "raw") {
  return "NRRD0004\ntype: uint8\ndimension: 3\nsizes: " + sizes + "\nencoding: " + encoding + "\n" + more + "\n";
}

TEST(RefusedImages, MissingFilesFoldersAndUnknownSuffixes) {
  const TemporaryFolder folder;
  EXPECT_THAT(error_for(folder / "absent.mha"), ::testing::HasSubstr("there is no such file"));
  std::filesystem::create_directory(folder / "folder.nrrd");
  EXPECT_THAT(error_for(folder / "folder.nrrd"), ::testing::HasSubstr("not a regular file"));
  EXPECT_THROW(read_volume<3>(folder / "image.tif"), InvalidInput);
  EXPECT_THROW(image_dimension(folder / "image.mhd"), InvalidInput);
}

TEST(RefusedImages, ContentOfAnotherKind) {
  const TemporaryFolder folder;
  for (const char* name : {"a.mha", "a.nii", "a.nii.gz", "a.nrrd", "a.png"}) {
    write_bytes(folder / name, "");
    EXPECT_THAT(error_for(folder / name), ::testing::HasSubstr("cannot read")) << name;
    write_bytes(folder / name, std::string(1000, 'x'));
    EXPECT_THAT(error_for(folder / name), ::testing::HasSubstr("cannot read")) << name;
  }
}

TEST(RefusedImages, AnotherDimensionOrNumberOfComponents) {
  const TemporaryFolder folder;
  write_volume(folder / "flat.mha", sample_volume<2>());
  write_vector_volume(folder / "field.mha", sample_vectors<3>());
  EXPECT_THAT(error_for<3>(folder / "flat.mha"), ::testing::HasSubstr("it is a 2-D image where a 3-D image is needed"));
  EXPECT_THAT(error_for<3>(folder / "field.mha"), ::testing::HasSubstr("it has 3 components a voxel"));
  EXPECT_THROW(read_vector_volume<2>(folder / "flat.mha"), FileError);
  EXPECT_THROW(read_vector_volume<2>(folder / "field.mha"), FileError);
}

TEST(RefusedImages, HeadersThatNameAnotherFile) {
  const TemporaryFolder folder;
  write_bytes(folder / "voxels.raw", std::string(8, 'v'));
  // The control: with the voxels attached, the same headers are good.
  write_bytes(folder / "good.mha", meta_header("2 2 2", "LOCAL") + "vvvvvvvv");
  EXPECT_EQ(read_volume<3>(folder / "good.mha").samples, std::vector<float>(8, 'v'));
  write_bytes(folder / "good.nrrd", nrrd_header("2 2 2", "") + "vvvvvvvv");
  EXPECT_EQ(read_volume<3>(folder / "good.nrrd").samples, std::vector<float>(8, 'v'));

  for (const char* data_file : {"voxels.raw", "LIST", "voxels%d.raw 1 2 1", "/etc/passwd", ""}) {
    write_bytes(folder / "a.mha", meta_header("2 2 2", data_file) + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("cannot read")) << data_file;
  }
  write_bytes(folder / "a.mha", meta_header("2 2 2", "voxels.raw") + "vvvvvvvv");
  EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("its voxels are in another file"));

  for (const char* field : {"data file: voxels.raw\n", "datafile: voxels.raw\n", "Data File: voxels.raw\n",
                            "data file: LIST\nvoxels.raw\n", "content: x\rdata file: voxels.raw\n"}) {
    write_bytes(folder / "a.nrrd", nrrd_header("2 2 2", field) + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.nrrd"), ::testing::HasSubstr("its voxels are in another file")) << field;
  }

  NiftiBytes nifti({2, 2, 2});
  write_bytes(folder / "good.nii", nifti.bytes + "vvvvvvvv");
  EXPECT_EQ(read_volume<3>(folder / "good.nii").samples, std::vector<float>(8, 'v'));
  std::memcpy(nifti.bytes.data() + 344, "ni1", 4);
  write_bytes(folder / "a.nii", nifti.bytes + "vvvvvvvv");
  write_bytes(folder / "a.img", "vvvvvvvv");
  EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("its voxels are in another file"));
  nifti.set<std::int32_t>(344, 0);  // ANALYZE 7.5 has no magic bytes
  write_bytes(folder / "a.nii", nifti.bytes + "vvvvvvvv");
  EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("it is not a NIfTI-1 file"));
}

TEST(RefusedImages, SizesThatTheFileCannotHoldAreRefusedFromTheHeader) {
  const TemporaryFolder folder;
  // 2^30 voxels would be a gigabyte, 2^31 + more than is allowed at all.
  write_bytes(folder / "a.mha", meta_header("1024 1024 1024", "LOCAL") + "v");
  EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("its header promises 1024x1024x1024 voxels"));
  write_bytes(folder / "a.nrrd", nrrd_header("1024 1024 1024", "") + "v");
  EXPECT_THAT(error_for(folder / "a.nrrd"), ::testing::HasSubstr("its header promises 1024x1024x1024 voxels"));
  write_bytes(folder / "b.nrrd", nrrd_header("1024 1024 1024", "", "gzip") + "v");
  EXPECT_THAT(error_for(folder / "b.nrrd"), ::testing::HasSubstr("its header promises 1024x1024x1024 voxels"));
  write_bytes(folder / "a.nii", NiftiBytes({1024, 1024, 1024}).bytes);
  EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("its header promises 1024x1024x1024 voxels"));

  write_bytes(folder / "b.mha", meta_header("65536 65536 65536", "LOCAL") + "v");
  EXPECT_THAT(error_for(folder / "b.mha"), ::testing::HasSubstr("2^31 voxels"));
  write_bytes(folder / "c.nrrd", nrrd_header("4294967296 4294967296 4294967296", "") + "v");
  EXPECT_THAT(error_for(folder / "c.nrrd"), ::testing::HasSubstr("cannot read"));
  write_bytes(folder / "b.nii", NiftiBytes({32767, 32767, 32767}).bytes);
  EXPECT_THAT(error_for(folder / "b.nii"), ::testing::HasSubstr("2^31 voxels"));
  write_bytes(folder / "c.mha", meta_header("0 2 2", "LOCAL") + "v");
  EXPECT_THAT(error_for(folder / "c.mha"), ::testing::HasSubstr("cannot read"));
  write_bytes(folder / "c.nii", NiftiBytes({-3, 2, 2}).bytes + "vvvv");
  EXPECT_THAT(error_for(folder / "c.nii"), ::testing::HasSubstr("cannot read"));
}

TEST(RefusedImages, FilesThatAreCutOff) {
  const TemporaryFolder folder;
  ImageGrid<3> grid;
  grid.size = {20, 20, 20};
  for (const char* name : {"a.mha", "a.nii", "a.nii.gz", "a.nrrd"}) {
    write_volume(folder / name, sample_volume(grid));
    const std::string whole = read_bytes(folder / name);
    for (const std::size_t length : {whole.size() - 1, whole.size() / 2, std::size_t{400}, std::size_t{100}}) {
      write_bytes(folder / name, whole.substr(0, length));
      EXPECT_THAT(error_for(folder / name), ::testing::HasSubstr("cannot read")) << name << " of length " << length;
    }
  }
  ImageGrid<2> flat;
  flat.size = {40, 40};
  write_volume(folder / "a.png", sample_volume(flat));
  const std::string whole = read_bytes(folder / "a.png");
  write_bytes(folder / "a.png", whole.substr(0, whole.size() / 2));
  EXPECT_THAT(error_for<2>(folder / "a.png"), ::testing::HasSubstr("cannot read"));
}

std::string gzipped(const std::string& bytes) {
  const auto path = std::filesystem::path(::testing::TempDir()) / ("saltus-gzip-" + std::to_string(getpid()));
  gzFile file = gzopen(path.c_str(), "wb");
  EXPECT_EQ(gzwrite(file, bytes.data(), bytes.size()), static_cast<int>(bytes.size()));
  EXPECT_EQ(gzclose(file), Z_OK);
  const std::string result = read_bytes(path);
  std::filesystem::remove(path);
  return result;
}

TEST(RefusedImages, CompressedVoxelsThatAreCutOffOrDamaged) {
  const TemporaryFolder folder;
  std::string voxels(20 * 20 * 20, '\0');
  for (std::size_t i = 0; i < voxels.size(); ++i) voxels[i] = static_cast<char>((i * i) % 251);
  std::string packed(compressBound(voxels.size()), '\0');
  uLongf length = packed.size();
  ASSERT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &length, reinterpret_cast<const Bytef*>(voxels.data()),
                     voxels.size()),
            Z_OK);
  packed.resize(length);
  std::string header = meta_header("20 20 20", "LOCAL", "CompressedDataSize = " + std::to_string(length) + "\n");
  header.replace(header.find("CompressedData = False"), 22, "CompressedData = True");
  write_bytes(folder / "a.mha", header + packed);
  EXPECT_EQ(read_volume<3>(folder / "a.mha").samples[333], (333 * 333) % 251);
  write_bytes(folder / "a.mha", header + packed.substr(0, length / 2));
  EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("cannot read"));
  std::string damaged = packed;
  damaged[length / 2] ^= 0x55;
  write_bytes(folder / "a.mha", header + damaged);
  EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("cannot read"));

  write_bytes(folder / "a.nii.gz", gzipped(NiftiBytes({20, 20, 20}).bytes + voxels));
  EXPECT_EQ(read_volume<3>(folder / "a.nii.gz").samples[333], (333 * 333) % 251);
  write_bytes(folder / "two.nii.gz", gzipped(NiftiBytes({20, 20, 20}).bytes) + gzipped(voxels));
  EXPECT_EQ(read_volume<3>(folder / "two.nii.gz").samples[333], (333 * 333) % 251);
  write_bytes(folder / "short.nii.gz", gzipped(NiftiBytes({20, 20, 20}).bytes + voxels.substr(1)));
  EXPECT_THAT(error_for(folder / "short.nii.gz"), ::testing::HasSubstr("cut off"));

  const std::string nrrd = nrrd_header("20 20 20", "", "gzip");
  write_bytes(folder / "a.nrrd", nrrd + gzipped(voxels));
  EXPECT_EQ(read_volume<3>(folder / "a.nrrd").samples[333], (333 * 333) % 251);
  for (const std::string& file : {read_bytes(folder / "a.nii.gz"), read_bytes(folder / "a.nrrd")}) {
    const auto name = file.starts_with("NRRD") ? "a.nrrd" : "a.nii.gz";
    write_bytes(folder / name, file.substr(0, file.size() - file.size() / 4));
    EXPECT_THAT(error_for(folder / name), ::testing::HasSubstr("cannot read")) << name;
    std::string broken = file;
    broken[file.size() * 3 / 4] ^= 0x55;
    write_bytes(folder / name, broken);
    EXPECT_THAT(error_for(folder / name), ::testing::HasSubstr("cannot read")) << name;
  }
}

/// A .mha of 2x2x2 bytes with one line replaced, or left out when `line` is "".
std::string meta_with(const std::string& key, const std::string& line) {
  std::istringstream lines(meta_header("2 2 2", "LOCAL"));
  std::string bytes;
  for (std::string old; std::getline(lines, old);) {
    const bool is_it = old.starts_with(key + " =");
    if (!is_it || !line.empty()) bytes += (is_it ? line : old) + '\n';
  }
  return bytes + "vvvvvvvv";
}

// ITK's reader does not come back from some of these, so it must never see them.
TEST(RefusedImages, MetaImageHeadersThatItkDoesNotUnderstand) {
  const TemporaryFolder folder;
  const std::pair<const char*, const char*> lines[] = {
      {"NDims", "NDims = -1"},
      {"NDims", "NDims = 99999999999999999999"},
      {"NDims", "NDims = 11"},
      {"NDims", "NDims = 3\nNDims = 2"},
      {"NDims", ""},
      {"NDims", "NDims = three"},
      {"DimSize", ""},
      {"DimSize", "DimSize = 2 2"},
      {"DimSize", "DimSize = 2 2 2 2"},
      {"DimSize", "DimSize = 2 2 2.5"},
      {"DimSize", "DimSize = 2 -2 -2"},
      {"ElementType", ""},
      {"ElementType", "ElementType = MET_STRING"},
      {"ElementType", "ElementType = UCHAR"},
      {"BinaryData", "BinaryData = maybe"},
      {"CompressedData", "CompressedData = True"},
      {"CompressedData", "CompressedData = True\nCompressedDataSize = 0"},
      {"CompressedData", "CompressedData = True\nCompressedDataSize = 9"},
      {"CompressedData", "CompressedData = True\nCompressedDataSize = -1"},
      {"Offset", "Offset = nan 0 0"},
      {"Offset", "Offset = 0 0 1e999"},
      {"Offset", "Offset 0 0 0"},
      {"Offset", "HeaderSize = -1"},
      {"Offset", "HeaderSize = 5"},
      {"Offset", "ElementNumberOfChannels = 0"},
      {"Offset", "ElementNumberOfChannels = 4294967297"},
      {"Offset", "Comment = a\001b"},
      {"Offset", "Color = 1 1 1"},
      {"ObjectType", "Offset = 0 0 0"},  // before NDims
  };
  write_bytes(folder / "a.mha", meta_with("Offset", "Offset = 1 2 3"));
  EXPECT_EQ(read_grid<3>(folder / "a.mha").origin, Vector<3>(1, 2, 3));
  for (const auto& [key, line] : lines) {
    write_bytes(folder / "a.mha", meta_with(key, line));
    EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("cannot read")) << line << " for " << key;
  }
}

TEST(RefusedImages, WhatOtherProgramsPutIntoMetaImageHeadersIsAllowed) {
  const TemporaryFolder folder;
  for (const char* line :
       {"Offset = +1 2.0 3e0", "Offset=1 2 3", "  Offset  =  1\t2  3 \nComment =", "Origin = 1 2 3\nName = \nID = -1",
        "Offset = 1 2 3\r", "Offset = 1 2 3\n0008|0005 = ISO_IR 100", "Offset = 1 2 3\nComment = a = b: \xc3\xb6",
        "Position = 1 2 3\nAnatomicalOrientation = RAI\nModality = MET_MOD_MR\nElementMin = -.5\nColor = 1 1 0 1"}) {
    write_bytes(folder / "a.mha", meta_with("Offset", line));
    EXPECT_EQ(error_for(folder / "a.mha"), "no error") << line;
    EXPECT_EQ(read_grid<3>(folder / "a.mha").origin, Vector<3>(1, 2, 3)) << line;
    EXPECT_EQ(read_volume<3>(folder / "a.mha").samples, std::vector<float>(8, 'v')) << line;
  }
  std::string lines_of_windows = meta_header("2 2 2", "LOCAL");
  for (std::size_t at = 0; (at = lines_of_windows.find('\n', at)) != std::string::npos; at += 2)
    lines_of_windows.insert(at, 1, '\r');
  write_bytes(folder / "a.mha", lines_of_windows + "vvvvvvvv");
  EXPECT_EQ(read_volume<3>(folder / "a.mha").samples, std::vector<float>(8, 'v'));
}

TEST(RefusedImages, EveryTypeOfMetaImageVoxelsHasTheSizeThatItkTakes) {
  const TemporaryFolder folder;
  const std::pair<const char*, std::size_t> types[] = {
      {"CHAR", 1}, {"UCHAR", 1}, {"SHORT", 2},     {"USHORT", 2},     {"INT", 4},   {"UINT", 4},
      {"LONG", 4}, {"ULONG", 4}, {"LONG_LONG", 8}, {"ULONG_LONG", 8}, {"FLOAT", 4}, {"DOUBLE", 8}};
  for (const auto& [type, size] : types) {
    const std::string bytes = meta_with("ElementType", std::string("ElementType = MET_") + type);
    const std::string header = bytes.substr(0, bytes.size() - 8);
    write_bytes(folder / "a.mha", header + std::string(8 * size, '\0'));
    EXPECT_EQ(error_for(folder / "a.mha"), "no error") << type;
    write_bytes(folder / "a.mha", header + std::string(8 * size - 1, '\0'));
    EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("its header promises")) << type;
  }
}

TEST(RefusedImages, VoxelsWrittenAsText) {
  const TemporaryFolder folder;
  const std::string bytes = meta_with("BinaryData", "BinaryData = False");
  const std::string header = bytes.substr(0, bytes.size() - 8);
  write_bytes(folder / "a.mha", header + "0 1 2\n3 4.0 +5 6e0\r\n7");
  EXPECT_EQ(read_volume<3>(folder / "a.mha").samples, (std::vector<float>{0, 1, 2, 3, 4, 5, 6, 7}));
  for (const char* voxels :
       {"0 1 2 3 4 5 6", "0 1 2 3 4 5 6.000", "0 1 2 3 x 5 6 7", "0 1 2 3 nan 5 6 7", "0 1 2 3 4"}) {
    write_bytes(folder / "a.mha", header + voxels);
    EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("cannot read")) << voxels;
  }
}

TEST(RefusedImages, CompressedVoxelsBeyondThoseThatWerePromised) {
  const TemporaryFolder folder;
  constexpr std::size_t much = std::size_t{3} << 20;
  write_bytes(folder / "a.nii.gz", gzipped(NiftiBytes({2, 2, 2}).bytes + std::string(1000, 'v')));
  EXPECT_EQ(error_for(folder / "a.nii.gz"), "no error");
  write_bytes(folder / "a.nii.gz", gzipped(NiftiBytes({2, 2, 2}).bytes + std::string(much, 'v')));
  EXPECT_THAT(error_for(folder / "a.nii.gz"), ::testing::HasSubstr("holds more voxels than its header promises"));
  write_bytes(folder / "a.nrrd", nrrd_header("2 2 2", "", "gzip") + gzipped(std::string(much, 'v')));
  EXPECT_THAT(error_for(folder / "a.nrrd"), ::testing::HasSubstr("holds more voxels than its header promises"));
}

TEST(RefusedImages, VoxelsThatDoNotFollowTheHeader) {
  const TemporaryFolder folder;
  for (const char* field : {"byte skip: 8\n", "byteskip: -1\n", "line skip: 1\n"}) {
    write_bytes(folder / "a.nrrd", nrrd_header("2 2 2", field) + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.nrrd"), ::testing::HasSubstr("do not follow its header")) << field;
  }
  write_bytes(folder / "a.nrrd", nrrd_header("2 2 2", "byte skip: 0\n") + "vvvvvvvv");
  EXPECT_EQ(error_for(folder / "a.nrrd"), "no error");
  const float infinity = std::numeric_limits<float>::infinity(), nothing = std::numeric_limits<float>::quiet_NaN();
  for (const float offset : {-352.0F, 1e30F, infinity, nothing}) {
    NiftiBytes nifti({2, 2, 2});
    nifti.set<float>(108, offset);
    write_bytes(folder / "a.nii", nifti.bytes + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("its voxels begin at byte")) << offset;
  }
}

TEST(RefusedImages, NiftiExtensionsThatEndBehindTheVoxels) {
  const TemporaryFolder folder;
  const auto with_extension = [](std::int32_t size) {
    NiftiBytes nifti({2, 2, 2});
    nifti.set<float>(108, 384).set<std::int32_t>(348, 1);
    nifti.bytes.resize(384, 'x');
    nifti.set<std::int32_t>(352, size).set<std::int32_t>(356, 6);
    return nifti.bytes + "vvvvvvvv";
  };
  write_bytes(folder / "a.nii", with_extension(32));
  EXPECT_EQ(read_volume<3>(folder / "a.nii").samples, std::vector<float>(8, 'v'));
  for (const std::int32_t size : {0, 7, 48, -16, 2147483647}) {
    write_bytes(folder / "a.nii", with_extension(size));
    EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("its extensions are damaged")) << size;
  }
}

TEST(RefusedImages, PlacesThatAreNotFinite) {
  const TemporaryFolder folder;
  const float infinity = std::numeric_limits<float>::infinity(), nothing = std::numeric_limits<float>::quiet_NaN();
  for (const float place : {infinity, -infinity, nothing, 1e38F}) {
    write_bytes(folder / "a.nii",
                NiftiBytes({2, 2, 2}).sform(1, {1, 0, 0, 0, 0, place, 0, 0, 0, 0, 1, 0}).bytes + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("no place in mm")) << place;
    write_bytes(folder / "a.nii", NiftiBytes({2, 2, 2}).half_turn_qform(1, place).bytes + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("no place in mm")) << place;
    // Nobody reads a form whose code is 0.
    write_bytes(folder / "a.nii", NiftiBytes({2, 2, 2}).half_turn_qform(0, place).bytes + "vvvvvvvv");
    EXPECT_EQ(error_for(folder / "a.nii"), "no error") << place;
  }
}

// What ITK says has the path in it, which is the name alone here.
TEST(RefusedImages, AFileOfTheCurrentFolder) {
  const TemporaryFolder folder;
  write_bytes(folder / "a.nrrd", nrrd_header("2 2 2", "space: nowhere\n") + "vvvvvvvv");
  const auto result = testing_support::run_guarded(1, [&](std::size_t) {
    std::filesystem::current_path(folder / ".");
    try {
      image_dimension("a.nrrd");
      return true;
    } catch (const FileError&) {
      return false;
    }
  });
  EXPECT_EQ(result.problem, "");
  EXPECT_EQ(result.counts[false], 1u);
}

TEST(RefusedImages, GridsThatCannotBeUsed) {
  const TemporaryFolder folder;
  std::string sheared = meta_header("2 2 2", "LOCAL") + "vvvvvvvv";
  sheared.replace(sheared.find("1 0 0 0 1 0"), 11, "1 0 0 .1 1 0");
  write_bytes(folder / "a.mha", sheared);
  EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("direction deviates from orthonormal"));
  std::string flat = meta_header("2 2 2", "LOCAL") + "vvvvvvvv";
  flat.replace(flat.find("ElementSpacing = 1 1 1"), 22, "ElementSpacing = 1 0 1");
  write_bytes(folder / "b.mha", flat);
  EXPECT_THAT(error_for(folder / "b.mha"), ::testing::HasSubstr("cannot read"));
  std::string nowhere = meta_header("2 2 2", "LOCAL") + "vvvvvvvv";
  nowhere.replace(nowhere.find("Offset = 0"), 10, "Offset = nan");
  write_bytes(folder / "c.mha", nowhere);
  EXPECT_THAT(error_for(folder / "c.mha"), ::testing::HasSubstr("cannot read"));
}

TEST(RefusedImages, SpacingsThatAreNoLengths) {
  const TemporaryFolder folder;
  for (const char* spacing : {"nan 1 1", "1 inf 1", "1 1 -inf", "0 0 0"}) {
    std::string header = meta_header("2 2 2", "LOCAL");
    header.replace(header.find("ElementSpacing = 1 1 1"), 22, "ElementSpacing = " + std::string(spacing));
    write_bytes(folder / "a.mha", header + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.mha"), ::testing::HasSubstr("cannot read")) << spacing;
  }
  for (const float spacing : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    NiftiBytes nifti({2, 2, 2});
    nifti.set<float>(80, spacing);  // pixdim[1]
    write_bytes(folder / "a.nii", nifti.bytes + "vvvvvvvv");
    EXPECT_THAT(error_for(folder / "a.nii"), ::testing::HasSubstr("cannot read")) << spacing;
  }
  write_bytes(folder / "a.nrrd",
              nrrd_header("2 2 2", "space directions: (nan,0,0) (0,1,0) (0,0,1)\nspace: LPS\n") + "vvvvvvvv");
  EXPECT_THAT(error_for(folder / "a.nrrd"), ::testing::HasSubstr("cannot read"));
}

TEST(RefusedImages, MoreThanThreeDimensions) {
  const TemporaryFolder folder;
  write_bytes(folder / "series.nii", NiftiBytes({2, 2, 2, 5}).bytes + std::string(40, 'v'));
  EXPECT_THAT(error_for(folder / "series.nii"), ::testing::HasSubstr("it has 4 dimensions (2x2x2x5)"));
  write_bytes(folder / "one.nii", NiftiBytes({2, 2, 2, 1}).bytes + std::string(8, 'v'));
  EXPECT_EQ(image_dimension(folder / "one.nii"), 3);
  EXPECT_EQ(read_volume<3>(folder / "one.nii").samples.size(), 8u);
  write_bytes(folder / "line.nii", NiftiBytes({4}).bytes + std::string(4, 'v'));
  EXPECT_THAT(error_for(folder / "line.nii"), ::testing::HasSubstr("it has 1 dimensions"));
}

TEST(RoundedDirections, BecomeOrthonormal) {
  const TemporaryFolder folder;
  std::string rounded = meta_header("2 2 2", "LOCAL") + "vvvvvvvv";
  rounded.replace(rounded.find("1 0 0 0 1 0"), 11, "0.8660 0.5000 0 -0.5000 0.8660 0");
  write_bytes(folder / "a.mha", rounded);
  const auto direction = read_grid<3>(folder / "a.mha").direction;
  EXPECT_LE((direction.transpose() * direction - Matrix<3>::Identity()).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_NEAR(direction(1, 0), 0.5, 1e-4);
}

}  // namespace
}  // namespace saltus
