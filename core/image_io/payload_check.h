#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>

namespace saltus {

/// Throws FileError unless the zlib or gzip streams in the `length` bytes (or up to the end of the file) from byte
/// `offset` are whole, undamaged, and hold at least `needed` bytes. ITK's readers of MetaImage and NIfTI take a stream
/// that breaks off for zeros. Of what is there beyond `needed`, no more than a mebibyte is unpacked: the file is
/// refused.
void check_compressed_payload(const std::filesystem::path& path, std::uint64_t offset, std::uint64_t needed,
                              std::uint64_t length = std::numeric_limits<std::uint64_t>::max());

/// Throws FileError unless at least `count` finite decimal numbers, with white space between them, follow byte
/// `offset`. ITK's reader of MetaImage takes what is no number for zero.
void check_text_payload(const std::filesystem::path& path, std::uint64_t offset, std::uint64_t count);

}  // namespace saltus
