// Images with damaged headers: every byte of the header changed, every length cut off, and changes at random. Each file
// is either read or refused with a FileError, whatever stands in it, without hanging, crashing, or taking more memory
// than a file of its size can be worth. What ITK does is not instrumented, so each batch runs in a process of its own
// with limits of processor time and memory.
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/support/blob_pair.h"
#include "tests/support/guarded_child.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <functional>
#include <random>
#include <stdexcept>

namespace saltus {
namespace {

using testing_support::run_guarded;

constexpr std::size_t random_changes = 1000;
constexpr int side = 12;

std::string zipped(const std::string& bytes, bool with_gzip_header) {
  z_stream stream{};
  if (deflateInit2(&stream, 6, Z_DEFLATED, with_gzip_header ? 31 : 15, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw std::bad_alloc();
  std::string packed(deflateBound(&stream, bytes.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  const int status = deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  if (status != Z_STREAM_END) throw std::runtime_error("deflate failed");
  return packed;
}

std::string same(const std::string& bytes) { return bytes; }
std::string gzip(const std::string& bytes) { return zipped(bytes, true); }

/// A good file, and where its header is.
struct Sample {
  std::string name, suffix;
  std::string bytes;
  std::size_t header_bytes;                                ///< these are damaged
  std::function<std::string(const std::string&)> to_file;  ///< after the damage was done
};

void PrintTo(const Sample& sample, std::ostream* out) { *out << sample.name; }

std::string written(const std::string& suffix) {
  const testing_support::TemporaryFolder folder;
  const auto file = folder / ("image." + suffix);
  write_volume(file, testing_support::blob_scene(side, 0));
  return testing_support::content_of(file);
}

std::string voxels() { return std::string(side * side, 'v'); }

std::string meta_header(const std::string& more) {
  return "ObjectType = Image\nNDims = 2\n" + more +
         "TransformMatrix = 1 0 0 1\nOffset = 0 0\nCenterOfRotation = 0 0\nComment = of nobody\nElementSpacing = 1 1\n"
         "DimSize = 12 12\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
}

std::vector<Sample> samples() {
  const std::string meta = written("mha"), nifti = written("nii"), nrrd = written("nrrd"), png = written("png");
  const std::string packed = zipped(voxels(), false);
  const std::string packed_header = meta_header(
      "BinaryData = True\nCompressedData = True\nCompressedDataSize = " + std::to_string(packed.size()) + "\n");
  std::string text;
  for (int i = 0; i < side * side; ++i) text += (i == 0 ? "" : i % side == 0 ? "\n" : " ") + std::to_string(i % 10);
  const std::string text_header = meta_header("BinaryData = False\n");
  const std::string zipped_nrrd =
      "NRRD0004\n# of nobody\ntype: uint8\ndimension: 2\nspace dimension: 2\nsizes: 12 12\nspace directions: (1,0) "
      "(0,1)\nkinds: domain domain\nencoding: gzip\nspace origin: (0,0)\nname:=value\n\n";
  // With one extension of 32 bytes, which makes the voxels begin at 384.
  std::string extended = nifti;
  extended.replace(348, 4, std::string("\1\0\0\0", 4) + std::string("\x20\0\0\0\6\0\0\0", 8) + std::string(24, 'x'));
  const float offset = 384;
  std::memcpy(extended.data() + 108, &offset, sizeof offset);
  constexpr std::size_t nifti_header = 352;
  return {
      {"MetaImage", "mha", meta, meta.find("LOCAL\n") + 6, same},
      {"CompressedMetaImage", "mha", packed_header + packed, packed_header.size() + packed.size(), same},
      {"TextMetaImage", "mha", text_header + text, text_header.size() + 20, same},
      {"Nifti", "nii", nifti, nifti_header, same},
      {"NiftiWithExtension", "nii", extended, nifti_header + 32, same},
      {"HeaderInCompressedNifti", "nii.gz", extended, nifti_header + 32, gzip},
      {"CompressedNifti", "nii.gz", gzip(nifti), gzip(nifti).size(), same},
      {"Nrrd", "nrrd", nrrd, nrrd.find("\n\n") + 2, same},
      {"CompressedNrrd", "nrrd", zipped_nrrd + gzip(voxels()), zipped_nrrd.size() + gzip(voxels()).size(), same},
      {"Png", "png", png, png.size(), same},
  };
}

class DamagedHeader : public testing::TestWithParam<Sample> {
 protected:
  /// True when the file was read, false when it was refused.
  bool is_read(const std::string& bytes) {
    const auto file = folder / ("image." + GetParam().suffix);
    // A new file: some file systems flush one that is written again.
    std::filesystem::remove(file);
    std::ofstream(file, std::ios::binary) << GetParam().to_file(bytes);
    try {
      if (image_dimension(file) == 2)
        read_volume<2>(file);
      else
        read_volume<3>(file);
      return true;
    } catch (const FileError& error) {
      const std::string said = error.what();
      if (said.empty() || said.find('\n') != std::string::npos) throw std::logic_error("not one sentence: " + said);
      // ITK turns an allocation that fails into an error of its own.
      if (said.find("alloc") != std::string::npos || said.find("memory") != std::string::npos) throw std::bad_alloc();
      return false;
    }
  }

  void expect_read_or_refused(std::size_t count, const std::function<std::string(std::size_t)>& damaged) {
    const auto result = run_guarded(count, [&](std::size_t i) { return is_read(damaged(i)); });
    if (!result.problem.empty()) {
      const std::string bytes = damaged(result.done);
      std::string shown;
      for (const char c : bytes.substr(0, GetParam().header_bytes + 20)) {
        char escaped[5];
        std::snprintf(escaped, sizeof escaped, "\\x%02x", static_cast<unsigned char>(c));
        shown += (c >= ' ' && c < 127) || c == '\n' ? std::string(1, c) : escaped;
      }
      ADD_FAILURE() << "case " << result.done << ": " << result.problem << '\n' << shown;
    }
    // Not all is good, or nothing was tried.
    EXPECT_GT(result.counts[false], 0u);
    read += result.counts[true];
  }

  /// One to four changes in the part where the header is.
  std::string damaged_at_random(std::size_t number) const {
    std::mt19937 generator(static_cast<unsigned>(number));
    const auto below = [&](std::size_t count) {
      return std::uniform_int_distribution<std::size_t>(0, count - 1)(generator);
    };
    static const std::string words[] = {"-1",
                                        "0",
                                        "1e999",
                                        "nan",
                                        "99999999999999999999",
                                        "2147483648",
                                        "",
                                        "../../../etc/passwd",
                                        "LOCAL",
                                        "%s%n",
                                        std::string(300, '9')};
    std::string bytes = GetParam().bytes;
    for (std::size_t i = below(4) + 1; i > 0 && !bytes.empty(); --i) {
      const std::size_t at = below(std::min(bytes.size(), GetParam().header_bytes));
      switch (below(5)) {
        case 0:
          bytes[at] = static_cast<char>(generator());
          break;
        case 1:
          bytes.erase(at, below(16) + 1);
          break;
        case 2:
          bytes.insert(at, bytes.substr(below(bytes.size()), below(40)));
          break;
        case 3:
          bytes.replace(at, below(8), words[below(std::size(words))]);
          break;
        default:
          if (below(8) == 0) bytes.resize(at + 1);
      }
    }
    return bytes;
  }

  testing_support::TemporaryFolder folder;
  std::size_t read = 0;
};

TEST_P(DamagedHeader, TheUndamagedFileIsRead) {
  const auto result = run_guarded(1, [&](std::size_t) { return is_read(GetParam().bytes); });
  EXPECT_EQ(result.problem, "");
  EXPECT_EQ(result.counts[true], 1u);
}

TEST_P(DamagedHeader, EveryByteChanged) {
  // Bits, the ends of the range, and what has a meaning in text.
  const std::string replacements(
      "\x00\xff\x01\x80\x7f"
      "9-\n =",
      10);
  const std::size_t kinds = replacements.size() + 2;
  expect_read_or_refused(kinds * GetParam().header_bytes, [&](std::size_t i) {
    std::string bytes = GetParam().bytes;
    char& byte = bytes[i / kinds];
    const std::size_t kind = i % kinds;
    byte = kind < replacements.size() ? replacements[kind]
                                      : static_cast<char>(byte ^ (kind == replacements.size() ? 1 : 0x80));
    return bytes;
  });
}

TEST_P(DamagedHeader, EveryByteLeftOutOrTwice) {
  expect_read_or_refused(2 * GetParam().header_bytes, [&](std::size_t i) {
    std::string bytes = GetParam().bytes;
    return i % 2 == 0 ? bytes.erase(i / 2, 1) : bytes.insert(i / 2, 1, bytes[i / 2]);
  });
}

TEST_P(DamagedHeader, CutOffAnywhere) {
  expect_read_or_refused(GetParam().bytes.size(), [&](std::size_t i) { return GetParam().bytes.substr(0, i); });
  // The last byte is a voxel's, or the end of a stream.
  EXPECT_EQ(read, 0u);
}

TEST_P(DamagedHeader, ChangedAtRandom) {
  expect_read_or_refused(random_changes, [&](std::size_t i) { return damaged_at_random(i); });
}

INSTANTIATE_TEST_SUITE_P(ImageFormats, DamagedHeader, testing::ValuesIn(samples()),
                         [](const auto& info) { return info.param.name; });

// That the guard sees what it is to see.
TEST(GuardedChild, ReportsWhatHangsCrashesThrowsEndsOrTakesTooMuch) {
  volatile bool forever = true;
  const auto problem_of = [](const std::function<void()>& bad) {
    const auto result = run_guarded(3,
                                    [&](std::size_t i) {
                                      if (i == 1) bad();
                                      return true;
                                    },
                                    {.cpu_seconds = 0, .memory = std::size_t{16} << 20});
    EXPECT_EQ(result.done, 1u);
    return result.problem;
  };
  EXPECT_EQ(problem_of([&] {
              while (forever)
                ;
            }),
            "it hangs");
  EXPECT_EQ(problem_of([] { std::raise(SIGSEGV); }), "it crashes: Segmentation fault");
  EXPECT_EQ(problem_of([] { throw std::runtime_error("no"); }), "it throws: no");
  EXPECT_EQ(problem_of([] { _exit(7); }), "it ends the process with code 7");
  EXPECT_EQ(problem_of([] { std::vector<char>(std::size_t{32} << 20); }), "it wants more memory than it may have");
}

}  // namespace
}  // namespace saltus
