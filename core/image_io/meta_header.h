#pragma once

#include <filesystem>

namespace saltus {

/// Throws FileError when the text header of a .mha has no end or holds a line that ITK's reader has no room for: it
/// copies values into fields of 255 characters without looking at their length.
void check_meta_header(const std::filesystem::path& path);

}  // namespace saltus
