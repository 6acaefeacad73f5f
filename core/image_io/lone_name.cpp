#include "core/image_io/lone_name.h"

#include "core/image_io/image_format.h"
#include "core/support/errors.h"

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <system_error>

namespace saltus {
namespace fs = std::filesystem;

namespace {

/// What the library would look for first, however its suffix is written.
bool has_sibling(const fs::path& file) {
  const std::string name = file.string();
  const std::string stem = name.substr(0, name.size() - std::string(".nii.gz").size());
  std::error_code unknown;
  for (const char* suffix : {".nii", ".NII", ".Nii"})
    if (fs::exists(stem + suffix, unknown)) return true;
  return false;
}

}  // namespace

LoneName::LoneName(const fs::path& file) : path_(file) {
  if (format_from_suffix(file) != ImageFormat::CompressedNifti || !has_sibling(file)) return;
  const auto fail = [&file](const std::string& what) {
    throw FileError("cannot read " + file.filename().string() + ": beside it lies one without .gz, and " + what +
                    "; move one of them, or let TMPDIR name a folder that can be written");
  };
  std::error_code error;
  std::string name = fs::temp_directory_path(error) / "saltus-image-XXXXXX";
  if (error) fail("there is no folder for temporary files");
  if (!mkdtemp(name.data())) fail(name + " cannot be made: " + std::strerror(errno));
  folder_ = name;
  path_ = folder_ / file.filename();
  fs::create_symlink(fs::absolute(file), path_, error);
  if (!error) return;
  fs::remove(folder_);
  fail(path_.string() + " cannot be made: " + error.message());
}

LoneName::~LoneName() {
  std::error_code ignored;  // what is left of a link in a temporary folder harms nobody
  if (!folder_.empty()) fs::remove_all(folder_, ignored);
}

}  // namespace saltus
