#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace saltus::testing {

inline std::string read_bytes(const std::filesystem::path& path) {
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return bytes.str();
}

inline void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

/// A NIfTI-1 header of single bytes, 352 long.
struct NiftiBytes {
  std::string bytes = std::string(352, '\0');

  template <typename Value>
  NiftiBytes& set(std::size_t offset, Value value) {
    std::memcpy(bytes.data() + offset, &value, sizeof value);
    return *this;
  }
  explicit NiftiBytes(std::vector<std::int16_t> size) {
    set<std::int32_t>(0, 348).set<std::int16_t>(40, size.size());
    for (std::size_t i = 0; i < 7; ++i) set<std::int16_t>(42 + 2 * i, i < size.size() ? size[i] : 1);
    set<std::int16_t>(70, 2).set<std::int16_t>(72, 8).set<float>(108, 352);
    for (int i = 0; i < 8; ++i) set<float>(76 + 4 * i, 1);
    std::memcpy(bytes.data() + 344, "n+1", 4);
  }
  /// Quaternion of a half turn about z, as a qform of this code.
  NiftiBytes& half_turn_qform(std::int16_t code, float x_offset) {
    return set<std::int16_t>(252, code).set<float>(264, 1).set<float>(268, x_offset);
  }
  NiftiBytes& sform(std::int16_t code, const std::array<float, 12>& rows) {
    set<std::int16_t>(254, code);
    for (int i = 0; i < 12; ++i) set<float>(280 + 4 * i, rows[i]);
    return *this;
  }
};

}  // namespace saltus::testing
