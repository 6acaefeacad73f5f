#include "core/image_io/slip_surface_io.h"

#include <charconv>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "core/image_io/temporary_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

void append(std::string& text, double value) {
  char number[32];
  // Nine digits are those of a float, and more than the measurement has.
  text.append(number, std::to_chars(number, number + sizeof number, value, std::chars_format::general, 9).ptr);
}

template <int Dim>
const char* area_name() {
  return Dim == 2 ? "length_mm" : "area_mm2";
}

void write_whole(const std::filesystem::path& path, const std::string& text) {
  TemporaryFile temporary(path);
  std::ofstream file(temporary.path(), std::ios::binary);
  file << text;
  file.close();
  if (!file)
    throw FileError("cannot write " + path.filename().string() + ": is the disk full, or the folder protected?");
  temporary.take_place();
}

/// One array of a VTK file: `components` values of every point.
template <int Dim>
struct PointArray {
  std::string name;
  int components;
  std::function<double(const SlipPoint<Dim>&, int)> value;
};

template <int Dim>
std::vector<PointArray<Dim>> point_arrays() {
  using Point = SlipPoint<Dim>;
  const auto component = [](const Vector<Dim>& vector, int c) { return c < Dim ? vector[c] : 0.0; };
  return {{"Normals", 3, [=](const Point& point, int c) { return component(point.normal, c); }},
          {area_name<Dim>(), 1, [](const Point& point, int) { return point.area; }},
          {"jump", 3, [=](const Point& point, int c) { return component(point.jump, c); }},
          {"jump_mm", 1, [](const Point& point, int) { return point.jump.norm(); }},
          {"gap_mm", 1, [](const Point& point, int) { return point.gap_mm; }},
          {"velocity_jump_mm", 1, [](const Point& point, int) { return point.velocity_jump_mm; }},
          {"part", 1, [](const Point& point, int) { return static_cast<double>(point.part); }}};
}

template <int Dim>
void append_array(std::string& text, const SlipSurface<Dim>& surface, const PointArray<Dim>& array) {
  text += "<DataArray type=\"Float64\" Name=\"" + array.name + "\" NumberOfComponents=\"" +
          std::to_string(array.components) + "\" format=\"ascii\">\n";
  for (const SlipPoint<Dim>& point : surface.points)
    for (int c = 0; c < array.components; ++c) {
      append(text, array.value(point, c));
      text.push_back(c + 1 < array.components ? ' ' : '\n');
    }
  text += "</DataArray>\n";
}

}  // namespace

template <int Dim>
void write_slip_csv(const std::filesystem::path& path, const SlipSurface<Dim>& surface) {
  std::string text;
  for (const char* prefix : {"", "normal_"})
    for (int axis = 0; axis < Dim; ++axis) text += std::string(prefix) + "xyz"[axis] + ",";
  text += std::string(area_name<Dim>()) + ",";
  for (int axis = 0; axis < Dim; ++axis) text += std::string("jump_") + "xyz"[axis] + ",";
  text += "jump_mm,gap_mm,velocity_jump_mm,part\n";
  for (const SlipPoint<Dim>& point : surface.points) {
    const auto add = [&](double value) {
      append(text, value);
      text.push_back(',');
    };
    for (int axis = 0; axis < Dim; ++axis) add(point.position[axis]);
    for (int axis = 0; axis < Dim; ++axis) add(point.normal[axis]);
    add(point.area);
    for (int axis = 0; axis < Dim; ++axis) add(point.jump[axis]);
    add(point.jump.norm());
    add(point.gap_mm);
    add(point.velocity_jump_mm);
    text += std::to_string(point.part) + "\n";
  }
  write_whole(path, text);
}

template <int Dim>
void write_slip_vtp(const std::filesystem::path& path, const SlipSurface<Dim>& surface) {
  const std::string count = std::to_string(surface.points.size());
  std::string text =
      "<?xml version=\"1.0\"?>\n"
      "<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">\n<PolyData>\n"
      "<Piece NumberOfPoints=\"" +
      count + "\" NumberOfVerts=\"" + count +
      "\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n"
      "<PointData Normals=\"Normals\" Vectors=\"jump\" Scalars=\"jump_mm\">\n";
  for (const PointArray<Dim>& array : point_arrays<Dim>()) append_array(text, surface, array);
  text += "</PointData>\n<Points>\n";
  append_array<Dim>(text, surface, {"Points", 3, [](const SlipPoint<Dim>& point, int c) {
                                      return c < Dim ? point.position[c] : 0.0;
                                    }});
  text += "</Points>\n<Verts>\n";
  for (const char* name : {"connectivity", "offsets"}) {
    text += "<DataArray type=\"Int64\" Name=\"" + std::string(name) + "\" format=\"ascii\">\n";
    const std::size_t first = name[0] == 'o' ? 1 : 0;  // an offset is where the next vertex begins
    for (std::size_t i = 0; i < surface.points.size(); ++i) text += std::to_string(i + first) + "\n";
    text += "</DataArray>\n";
  }
  text += "</Verts>\n</Piece>\n</PolyData>\n</VTKFile>\n";
  write_whole(path, text);
}

template void write_slip_csv(const std::filesystem::path&, const SlipSurface<2>&);
template void write_slip_csv(const std::filesystem::path&, const SlipSurface<3>&);
template void write_slip_vtp(const std::filesystem::path&, const SlipSurface<2>&);
template void write_slip_vtp(const std::filesystem::path&, const SlipSurface<3>&);

}  // namespace saltus
