#pragma once

#include <filesystem>

namespace saltus {

/// Throws FileError unless a .png is made of whole, undamaged chunks, and its first is a header that the format allows.
/// ITK reads the header without catching libpng's errors, which then end the process.
void check_png_chunks(const std::filesystem::path& path);

}  // namespace saltus
