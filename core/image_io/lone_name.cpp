#include "core/image_io/lone_name.h"

#include "core/support/errors.h"

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <system_error>

namespace saltus {
namespace fs = std::filesystem;

LoneName::LoneName(const fs::path& file) : path_(file) {
  if (file.extension() != ".gz" || !fs::exists(fs::path(file).replace_extension())) return;
  std::string name = fs::temp_directory_path() / "saltus-image-XXXXXX";
  if (!mkdtemp(name.data())) throw FileError(name + " cannot be made: " + std::strerror(errno));
  folder_ = name;
  path_ = folder_ / file.filename();
  std::error_code error;
  fs::create_symlink(fs::absolute(file), path_, error);
  if (!error) return;
  fs::remove(folder_);
  throw FileError(path_.string() + " cannot be made: " + error.message());
}

LoneName::~LoneName() {
  std::error_code ignored;  // what is left of a link in a temporary folder harms nobody
  if (!folder_.empty()) fs::remove_all(folder_, ignored);
}

}  // namespace saltus
