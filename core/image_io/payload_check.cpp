#include "core/image_io/payload_check.h"

#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "core/support/errors.h"

namespace saltus {

void check_compressed_payload(const std::filesystem::path& path, std::uint64_t offset, std::uint64_t needed,
                              std::uint64_t length) {
  auto refuse = [&path](const std::string& reason) {
    throw FileError("cannot read " + path.filename().string() + ": " + reason);
  };
  std::ifstream file(path, std::ios::binary);
  file.seekg(static_cast<std::streamoff>(offset));
  z_stream stream{};
  constexpr int any_header = 15 + 32;
  if (inflateInit2(&stream, any_header) != Z_OK) throw std::bad_alloc();
  const std::unique_ptr<z_stream, decltype(&inflateEnd)> owner(&stream, &inflateEnd);

  std::vector<char> input(1 << 16), output(1 << 18);
  constexpr std::uint64_t most_padding = 1 << 20;
  std::uint64_t total = 0;
  bool is_whole = false;
  const auto read_on = [&] {
    file.read(input.data(), static_cast<std::streamsize>(std::min<std::uint64_t>(input.size(), length)));
    length -= static_cast<std::uint64_t>(file.gcount());
    return file.gcount() > 0;
  };
  while (length > 0 && read_on()) {
    stream.next_in = reinterpret_cast<Bytef*>(input.data());
    stream.avail_in = static_cast<uInt>(file.gcount());
    do {
      // What follows a whole stream is padding, unless more is needed: then it is the next stream.
      if (is_whole && total >= needed) return;
      if (is_whole) inflateReset(&stream);
      is_whole = false;
      stream.next_out = reinterpret_cast<Bytef*>(output.data());
      stream.avail_out = static_cast<uInt>(output.size());
      const int status = inflate(&stream, Z_NO_FLUSH);
      if (status != Z_OK && status != Z_STREAM_END && status != Z_BUF_ERROR)
        refuse("its compressed voxels are damaged");
      total += output.size() - stream.avail_out;
      if (total > needed + most_padding) refuse("it holds more voxels than its header promises");
      is_whole = status == Z_STREAM_END;
    } while (stream.avail_in > 0 || stream.avail_out == 0);
  }
  if (!is_whole || total < needed) refuse("its compressed voxels break off; it is cut off or damaged");
}

void check_text_payload(const std::filesystem::path& path, std::uint64_t offset, std::uint64_t count) {
  auto refuse = [&path](const std::string& reason) {
    throw FileError("cannot read " + path.filename().string() + ": " + reason);
  };
  constexpr std::size_t longest_number = 64;
  std::ifstream file(path, std::ios::binary);
  file.seekg(static_cast<std::streamoff>(offset));
  std::string word;
  for (std::uint64_t found = 0; found < count;) {
    const int c = file.get();
    const bool is_end = c == std::ifstream::traits_type::eof();
    if (!is_end && c != ' ' && c != '\t' && c != '\n' && c != '\r') {
      if (word.size() == longest_number) refuse("its voxels are not written as numbers");
      word += static_cast<char>(c);
      continue;
    }
    if (!word.empty()) {
      double value = 0;
      const char *begin = word.data() + (word.front() == '+'), *end = word.data() + word.size();
      const auto [last, error] = std::from_chars(begin, end, value);
      if (error != std::errc() || last != end || !std::isfinite(value)) refuse("its voxels are not written as numbers");
      ++found;
      word.clear();
    }
    if (is_end && found < count) refuse("its voxels break off; it is cut off or damaged");
  }
}

}  // namespace saltus
