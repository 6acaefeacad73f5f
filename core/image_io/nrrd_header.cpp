#include "core/image_io/nrrd_header.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <string>

#include "core/support/errors.h"

namespace saltus {
namespace {

/// Lower case, without any white space, so that "Data File" and "datafile" are the same.
std::string normalised(std::string_view text) {
  std::string result;
  for (unsigned char c : text) {
    if (!std::isspace(c)) result.push_back(std::tolower(c));
  }
  return result;
}

}  // namespace

NrrdHeader read_nrrd_header(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  constexpr std::size_t longest_header = 1 << 20;
  std::string text(longest_header, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file) throw FileError("cannot read " + name + ": it cannot be opened");
  file.read(text.data(), text.size());
  text.resize(file.gcount());
  if (!text.starts_with("NRRD000")) throw FileError("cannot read " + name + ": it is not a NRRD file");
  const std::size_t end = std::min(text.find("\n\n"), text.find("\n\r\n"));

  NrrdHeader header;
  // A lone carriage return also separates lines here, so that no reader sees a field that this one does not.
  std::size_t begin = 0;
  while (begin < std::min(end, text.size())) {
    const std::size_t line_end = std::min(text.find_first_of("\r\n", begin), text.size());
    const std::string_view line = std::string_view(text).substr(begin, line_end - begin);
    begin = line_end + 1;
    const std::size_t colon = line.find(':');
    if (line.starts_with("#") || colon == std::string_view::npos) continue;
    const std::string key = normalised(line.substr(0, colon));
    if (key == "datafile")
      throw FileError("cannot read " + name +
                      ": its voxels are in another file; save header and voxels in one .nrrd file");
    if ((key == "byteskip" || key == "lineskip") && normalised(line.substr(colon + 1)) != "0")
      throw FileError("cannot read " + name + ": its voxels do not follow its header; save it without '" +
                      (key == "byteskip" ? "byte skip'" : "line skip'"));
    if (key == "encoding") {
      const std::string encoding = normalised(line.substr(colon + 1));
      header.is_raw = encoding == "raw";
      header.is_gzip = encoding == "gzip" || encoding == "gz";
    }
  }
  if (end == std::string::npos) throw FileError("cannot read " + name + ": its header has no end");
  header.data_offset = text.find('\n', end + 1) + 1;
  return header;
}

}  // namespace saltus
