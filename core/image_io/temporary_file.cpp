#include "core/image_io/temporary_file.h"

#include <unistd.h>

#include <atomic>
#include <sstream>
#include <string>
#include <utility>

#include "core/support/errors.h"

namespace saltus {

TemporaryFile::TemporaryFile(std::filesystem::path target) : target_(std::move(target)) {
  static std::atomic<unsigned> serial{0};
  const std::string name = target_.filename().string();
  const auto folder = target_.has_parent_path() ? target_.parent_path() : std::filesystem::path(".");
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error))
    throw FileError("cannot write " + name + ": the folder " + folder.filename().string() + " does not exist");
  // Process and counter keep writers of the same target apart.
  std::ostringstream unique;
  unique << '.' << getpid() << '-' << serial++ << '-' << name;
  path_ = folder / unique.str();
}

TemporaryFile::~TemporaryFile() {
  std::error_code ignored;  // Moved already, or never made.
  std::filesystem::remove(path_, ignored);
}

void TemporaryFile::take_place() {
  std::error_code error;
  std::filesystem::rename(path_, target_, error);
  if (error) throw FileError("cannot write " + target_.filename().string() + ": " + error.message());
}

}  // namespace saltus
