#include "core/image_io/png_chunks.h"

#include <zlib.h>

#include <array>
#include <cstdint>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "core/support/errors.h"

namespace saltus {
namespace {

constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);
constexpr std::uint32_t kLargestSide = 1000000;  // libpng's own limit
constexpr std::uint32_t kPaletteEntry = 3, kLargestPalette = 256 * kPaletteEntry;

std::uint32_t big_endian(const unsigned char* bytes) {
  return std::uint32_t{bytes[0]} << 24 | std::uint32_t{bytes[1]} << 16 | std::uint32_t{bytes[2]} << 8 | bytes[3];
}

bool is_good_header(const std::vector<unsigned char>& data) {
  if (data.size() != 13) return false;
  const std::uint32_t width = big_endian(data.data()), height = big_endian(data.data() + 4);
  if (width < 1 || width > kLargestSide || height < 1 || height > kLargestSide) return false;
  const int depth = data[8], colour = data[9];
  const bool is_byte = depth == 8 || depth == 16, is_small = depth == 1 || depth == 2 || depth == 4;
  const bool is_good_colour = (colour == 0 && (is_byte || is_small)) || (colour == 3 && (depth == 8 || is_small)) ||
                              ((colour == 2 || colour == 4 || colour == 6) && is_byte);
  return is_good_colour && data[10] == 0 && data[11] == 0 && data[12] <= 1;
}

}  // namespace

void check_png_chunks(const std::filesystem::path& path) {
  const auto refuse = [&path](const std::string& reason) {
    throw FileError("cannot read " + path.filename().string() + ": " + reason);
  };
  std::ifstream file(path, std::ios::binary);
  if (!file) refuse("it cannot be opened");
  std::uintmax_t left = std::filesystem::file_size(path);
  const auto read = [&](void* to, std::size_t size) {
    if (size > left || !file.read(static_cast<char*>(to), static_cast<std::streamsize>(size)))
      refuse("it is cut off or damaged");
    left -= size;
  };
  std::array<char, 8> signature;
  read(signature.data(), signature.size());
  if (std::string_view(signature.data(), signature.size()) != kSignature)
    refuse("its content is not what its name promises");
  bool is_first = true, needs_palette = false;
  while (true) {
    std::array<unsigned char, 8> head;
    read(head.data(), head.size());
    const std::uint32_t size = big_endian(head.data());
    if (size > left) refuse("it is cut off or damaged");
    std::vector<unsigned char> data(size);
    read(data.data(), data.size());
    std::array<unsigned char, 4> stored;
    read(stored.data(), stored.size());
    const auto name_sum = crc32(0, head.data() + 4, 4);
    const auto sum = size > 0 ? crc32(name_sum, data.data(), size) : name_sum;
    if (sum != big_endian(stored.data())) refuse("it is damaged, the checksum of a chunk does not match");
    const std::string_view name(reinterpret_cast<const char*>(head.data()) + 4, 4);
    if (is_first != (name == "IHDR")) refuse("its chunks are not in the order of a PNG");
    if (is_first && !is_good_header(data)) refuse("its header is not one of a PNG");
    if (is_first) needs_palette = data[9] == 3;
    if (name == "PLTE") {
      if (size == 0 || size > kLargestPalette || size % kPaletteEntry != 0) refuse("its palette is damaged");
      needs_palette = false;
    }
    if (name == "IDAT" && needs_palette) refuse("it has no palette");
    if (name == "IEND") return;
    is_first = false;
  }
}

}  // namespace saltus
