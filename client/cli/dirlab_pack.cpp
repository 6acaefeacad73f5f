#include "client/cli/dirlab_pack.h"

#include "core/support/errors.h"

#include <cstdint>
#include <fstream>
#include <regex>
#include <sstream>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

fs::path find_one(const fs::path& root, const std::string& what, const std::string& name_pattern) {
  const std::regex pattern(name_pattern, std::regex::icase);
  std::vector<fs::path> found;
  for (const auto& entry : fs::recursive_directory_iterator(root))
    if (entry.is_regular_file() && std::regex_match(entry.path().filename().string(), pattern))
      found.push_back(entry.path());
  if (found.size() == 1) return found.front();
  if (found.empty())
    throw FileError("--root " + root.string() + " has no " + what + " below it; unpack the case's pack there");
  throw FileError("--root " + root.string() + " has " + what + " more than once: " + found[0].string() + " and " +
                  found[1].string() + "; leave one of them");
}

}  // namespace

const std::vector<DirlabCase>& dirlab_cases() {
  static const std::vector<DirlabCase> cases{
      {1, {256, 256, 94}, {0.97, 0.97, 2.5}, 3.89},   {2, {256, 256, 112}, {1.16, 1.16, 2.5}, 4.34},
      {3, {256, 256, 104}, {1.15, 1.15, 2.5}, 6.94},  {4, {256, 256, 99}, {1.13, 1.13, 2.5}, 9.83},
      {5, {256, 256, 106}, {1.10, 1.10, 2.5}, 7.48},  {6, {512, 512, 128}, {0.97, 0.97, 2.5}, 10.89},
      {7, {512, 512, 136}, {0.97, 0.97, 2.5}, 11.03}, {8, {512, 512, 128}, {0.97, 0.97, 2.5}, 14.99},
      {9, {512, 512, 128}, {0.97, 0.97, 2.5}, 7.92},  {10, {512, 512, 120}, {0.97, 0.97, 2.5}, 7.30}};
  return cases;
}

DirlabPaths find_dirlab_case(const fs::path& root, int number) {
  if (!fs::is_directory(root)) throw FileError("--root " + root.string() + " is no folder");
  const std::string name = "case0*" + std::to_string(number) + "_", who = " of case " + std::to_string(number);
  const auto image = [&](const std::string& phase) {
    return find_one(root, "image of phase " + phase + who, name + phase + "([-_](s|ssm))?\\.img");
  };
  const auto points = [&](const std::string& phase) {
    return find_one(root, "300 landmarks of phase " + phase + who, name + "(dirlab)?300_" + phase + "_xyz.*\\.txt");
  };
  return {image("T00"), image("T50"), points("T00"), points("T50")};
}

Volume<3> read_dirlab_image(const fs::path& file, const DirlabCase& about) {
  ImageGrid<3> grid;
  grid.size = about.size;
  grid.spacing = about.spacing;
  const std::uintmax_t expected = 2 * grid.voxels(), bytes = fs::file_size(file);
  if (bytes != expected)
    throw FileError(file.string() + " has " + std::to_string(bytes) + " bytes; case " + std::to_string(about.number) +
                    " has " + size_text<3>(grid.size) + " voxels of two bytes, " + std::to_string(expected));
  Volume<3> image(grid);
  std::vector<unsigned char> slice(2 * static_cast<std::size_t>(grid.size[0]) * grid.size[1]);
  std::ifstream in(file, std::ios::binary);
  for (std::size_t voxel = 0; voxel < image.samples.size();) {
    in.read(reinterpret_cast<char*>(slice.data()), static_cast<std::streamsize>(slice.size()));
    if (!in) throw FileError(file.string() + " cannot be read to its end");
    for (std::size_t at = 0; at < slice.size(); at += 2, ++voxel)
      image.samples[voxel] = static_cast<std::int16_t>(static_cast<std::uint16_t>(slice[at] | slice[at + 1] << 8));
  }
  return image;
}

std::vector<Vector<3>> read_dirlab_points(const fs::path& file, const DirlabCase& about) {
  std::ifstream in(file);
  if (!in) throw FileError(file.string() + " cannot be read");
  std::vector<Vector<3>> points;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::istringstream words(line);
    Vector<3> index;
    std::string more;
    if (!(words >> index[0] >> index[1] >> index[2]) || words >> more)
      throw FileError(file.string() + ": line " + std::to_string(number) + " is '" + line + "', not three numbers");
    for (int axis = 0; axis < 3; ++axis)
      if (!(index[axis] >= 1 && index[axis] <= about.size[axis]))
        throw FileError(file.string() + ": line " + std::to_string(number) + " lies outside of the " +
                        size_text<3>(about.size) + " voxels, which count from 1");
    points.push_back((index - Vector<3>::Ones()).cwiseProduct(about.spacing));
  }
  if (points.empty()) throw FileError(file.string() + " has no points");
  return points;
}

}  // namespace saltus::cli
