#pragma once

#include "core/grid/volume.h"

#include <filesystem>
#include <vector>

namespace saltus::cli {

/// What is known of one of the ten DIR-Lab 4-D CT cases (www.dir-lab.com) before its files are read.
struct DirlabCase {
  int number = 0;
  Index<3> size{};
  Vector<3> spacing = Vector<3>::Ones();  ///< mm
  double initial_error_mm = 0;            ///< mean distance of its 300 landmark pairs, as published
};

/// The cases 1 to 10, in order.
const std::vector<DirlabCase>& dirlab_cases();

/// The extreme phases of a case: T00, inhale, and T50, exhale.
struct DirlabPaths {
  std::filesystem::path inhale, exhale;                ///< raw 16-bit voxels, little endian
  std::filesystem::path inhale_points, exhale_points;  ///< text, a point a line, voxel indices from 1
};

/// Finds the files of a case anywhere below `root` by their names, which differ from pack to pack: caseN_T00_s.img,
/// caseN_T00-ssm.img or caseN_T00.img, and CaseN_300_T00_xyz.txt or caseN_dirLab300_T00_xyz.txt. Throws FileError that
/// names what is missing, or what is there twice.
DirlabPaths find_dirlab_case(const std::filesystem::path& root, int number);

/// Reads voxels of a case on a grid that begins at 0 with axes along the world's. Throws FileError when the file does
/// not have exactly the bytes that the case's size asks for.
Volume<3> read_dirlab_image(const std::filesystem::path& file, const DirlabCase& about);

/// Reads landmarks as world mm on that grid: (index - 1) * spacing. Throws FileError that names the line for what are
/// no three numbers or no indices of the image.
std::vector<Vector<3>> read_dirlab_points(const std::filesystem::path& file, const DirlabCase& about);

}  // namespace saltus::cli
