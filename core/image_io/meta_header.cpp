#include "core/image_io/meta_header.h"

#include <algorithm>
#include <fstream>
#include <string>

#include "core/support/errors.h"

namespace saltus {

void check_meta_header(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  // Nine numbers of 24 characters, and the name before them.
  constexpr std::size_t longest_line = 250, longest_header = 1 << 16;
  std::string text(longest_header, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file) throw FileError("cannot read " + name + ": it cannot be opened");
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    if (end - begin > longest_line)
      throw FileError("cannot read " + name + ": its header has a line of more than " + std::to_string(longest_line) +
                      " characters; shorten it");
    if (text.compare(begin, 15, "ElementDataFile") == 0) return;
    begin = end + 1;
  }
  throw FileError("cannot read " + name + ": its header has no line ElementDataFile");
}

}  // namespace saltus
