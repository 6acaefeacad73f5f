#pragma once

#include <filesystem>
#include <string>

#include "core/support/errors.h"

namespace saltus {

/// A file that cannot be read, by its name without its folder.
[[noreturn]] inline void refuse(const std::filesystem::path& path, const std::string& reason) {
  throw FileError("cannot read " + path.filename().string() + ": " + reason);
}

}  // namespace saltus
