// Images with damaged headers, at random: each is either read or refused with a FileError, whatever stands in it.
// MetaImage is left out: its reader can hang on a damaged header, which only the end of the worker helps against.
// What ITK does with it is not instrumented, so this is blind where the libFuzzer targets see.
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/support/blob_pair.h"
#include "tests/support/temporary_folder.h"

#include <random>

namespace saltus {
namespace {

constexpr int mutations = 1000;
constexpr std::size_t header_bytes = 352;

class DamagedHeader : public testing::TestWithParam<std::string> {
 protected:
  /// One to four changes in the part where the header is.
  std::string damaged(std::string bytes) {
    const auto below = [this](std::size_t count) {
      return std::uniform_int_distribution<std::size_t>(0, count - 1)(generator);
    };
    static const std::string numbers[] = {"-1",
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
    for (std::size_t i = below(4) + 1; i > 0; --i) {
      const std::size_t at = below(std::min(bytes.size(), header_bytes));
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
          bytes.replace(at, below(8), numbers[below(std::size(numbers))]);
          break;
        default:
          if (below(8) == 0) bytes.resize(at + 1);
      }
      if (bytes.empty()) return bytes;
    }
    return bytes;
  }

  std::mt19937 generator{20};
  testing_support::TemporaryFolder folder;
};

TEST_P(DamagedHeader, IsReadOrRefused) {
  const auto file = folder / ("image." + GetParam());
  write_volume(file, testing_support::blob_scene(12, 0));
  const std::string good = testing_support::content_of(file);
  int read = 0, refused = 0;
  for (int i = 0; i < mutations; ++i) {
    std::ofstream(file, std::ios::binary | std::ios::trunc) << damaged(good);
    try {
      if (image_dimension(file) == 2) read_volume<2>(file);
      ++read;
    } catch (const FileError& error) {
      EXPECT_STRNE(error.what(), "");
      ++refused;
    }
  }
  // Both happen, or nothing was tried.
  EXPECT_GT(read, 0);
  EXPECT_GT(refused, 0);
}

INSTANTIATE_TEST_SUITE_P(ImageFormats, DamagedHeader, testing::Values("nrrd", "nii", "png"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace saltus
