#include "core/image_io/points_io.h"

#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>

#include "core/image_io/temporary_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

std::string_view without_blanks(std::string_view text) {
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (std::size_t begin = 0;;) {
    const std::size_t comma = line.find(',', begin);
    fields.push_back(without_blanks(line.substr(begin, comma - begin)));
    if (comma == std::string_view::npos) return fields;
    begin = comma + 1;
  }
}

std::optional<double> finite_number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace

template <int Dim>
std::vector<Vector<Dim>> read_points(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  std::ifstream file(path);
  if (!file) throw FileError("cannot read " + name + ": there is no such file, or it may not be read");

  std::vector<Vector<Dim>> points;
  std::size_t columns = 0;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    auto refuse = [&](const std::string& reason) {
      throw FileError("cannot read " + name + ": line " + std::to_string(number) + " " + reason);
    };
    if (number == 1 && line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
    if (without_blanks(line).empty()) continue;
    const std::vector<std::string_view> fields = split(line);
    if (columns == 0) {
      const bool has_xy = fields.size() >= 2 && fields[0] == "x" && fields[1] == "y";
      const bool has_z = fields.size() == 3 && fields[2] == "z";
      if (!has_xy || !(has_z || (Dim == 2 && fields.size() == 2)))
        refuse("is '" + std::string(without_blanks(line)) + "'; the first line must be " +
               (Dim == 2 ? "x,y" : "x,y,z"));
      columns = fields.size();
      continue;
    }
    if (fields.size() != columns)
      refuse("has " + std::to_string(fields.size()) + " fields; the header has " + std::to_string(columns));
    Vector<Dim> point;
    for (std::size_t column = 0; column < columns; ++column) {
      const auto value = finite_number(fields[column]);
      if (!value) refuse("has '" + std::string(fields[column]) + "' where a finite number is needed");
      if (static_cast<int>(column) < Dim) {
        point[column] = *value;
      } else if (*value != 0) {
        refuse("has z = " + std::string(fields[column]) + "; points of 2-D images need z = 0, or the header x,y");
      }
    }
    points.push_back(point);
  }
  if (!file.eof()) throw FileError("cannot read " + name + ": reading stopped before its end");
  if (columns == 0) throw FileError("cannot read " + name + ": it is empty");
  if (points.empty()) throw FileError("cannot read " + name + ": it has a header but no points");
  return points;
}

template <int Dim>
void write_points(const std::filesystem::path& path, const std::vector<Vector<Dim>>& points) {
  const std::string name = path.filename().string();
  std::string text = Dim == 2 ? "x,y\n" : "x,y,z\n";
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int axis = 0; axis < Dim; ++axis) {
      if (!std::isfinite(points[i][axis]))
        throw InvalidInput("point " + std::to_string(i) + " for " + name + " is not finite; write finite points only");
      char number[32];
      const auto end = std::to_chars(number, number + sizeof number, points[i][axis]).ptr;
      text.append(number, end).push_back(axis + 1 < Dim ? ',' : '\n');
    }
  }
  TemporaryFile temporary(path);
  std::ofstream file(temporary.path(), std::ios::binary);
  file << text;
  file.close();
  if (!file) throw FileError("cannot write " + name + ": is the disk full, or the folder protected?");
  temporary.take_place();
}

template std::vector<Vector<2>> read_points<2>(const std::filesystem::path&);
template std::vector<Vector<3>> read_points<3>(const std::filesystem::path&);
template void write_points<2>(const std::filesystem::path&, const std::vector<Vector<2>>&);
template void write_points<3>(const std::filesystem::path&, const std::vector<Vector<3>>&);

}  // namespace saltus
