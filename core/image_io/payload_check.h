#pragma once

#include <cstdint>
#include <filesystem>

namespace saltus {

/// Throws FileError unless the zlib or gzip streams that begin at byte `offset` of the file are whole, undamaged, and
/// hold at least `needed` bytes. ITK's readers of MetaImage and NIfTI take a stream that breaks off for zeros.
void check_compressed_payload(const std::filesystem::path& path, std::uint64_t offset, std::uint64_t needed);

}  // namespace saltus
