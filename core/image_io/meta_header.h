#pragma once

#include <array>
#include <cstdint>
#include <filesystem>

namespace saltus {

/// What the text header of a .mha says about its voxels.
struct MetaHeader {
  static constexpr int most_dimensions = 10;  ///< as many as ITK's reader has room for

  int dimension = 0;
  std::array<std::uint64_t, most_dimensions> size{};
  int components = 1;
  std::uint64_t voxel_bytes = 0;  ///< all voxels, not compressed
  bool is_text = false;           ///< voxels are written out as decimal numbers
  bool is_compressed = false;
  std::uint64_t compressed_bytes = 0;  ///< when they are
  std::uint64_t data_offset = 0;       ///< byte at which the voxels begin
};

/// Reads the header of a .mha and throws FileError unless every line is one that ITK's reader understands: after the
/// first it does not understand, that reader goes on with fields it never set, and may not come back. Demanded are:
///  - lines `Key = value` of at most 250 characters, at most 64 KiB in all, ended by ElementDataFile = LOCAL;
///  - each known key once, NDims before the keys that depend on it, as many finite numbers as the key has;
///  - 1 to 10 axes, at most 2^31 voxels of 1 to 16 numbers, and no more of them than the file's length can hold.
/// Keys that the format does not know are allowed; their values are text that nobody reads.
MetaHeader read_meta_header(const std::filesystem::path& path);

}  // namespace saltus
