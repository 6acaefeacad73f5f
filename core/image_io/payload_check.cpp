#include "core/image_io/payload_check.h"

#include <zlib.h>

#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "core/support/errors.h"

namespace saltus {

void check_compressed_payload(const std::filesystem::path& path, std::uint64_t offset, std::uint64_t needed) {
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
  std::uint64_t total = 0;
  bool is_whole = false;
  while (file.read(input.data(), input.size()), file.gcount() > 0) {
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
      is_whole = status == Z_STREAM_END;
    } while (stream.avail_in > 0 || stream.avail_out == 0);
  }
  if (!is_whole || total < needed) refuse("its compressed voxels break off; it is cut off or damaged");
}

}  // namespace saltus
