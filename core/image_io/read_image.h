#pragma once

#include <filesystem>

#include "core/grid/volume.h"
#include "core/image_io/image_format.h"

namespace saltus {

/// Images are read to float on their own grid: spacing, origin and direction as ITK 5.2 understands the file, in LPS
/// world millimetres. What that means where formats are ambiguous:
///  - NIfTI: the RAS coordinates of the file become LPS. The sform is used when its code is 1 (scanner) or the qform's
///    code is 0, and it has no shear; otherwise the qform. A file with neither gets its header's spacing only.
///  - NIfTI: a voxel is scl_slope * stored + scl_inter, unless scl_slope is 0 or NaN. Several values a voxel need the
///    intent code of a vector.
///  - Direction cosines that a header rounded are replaced by the nearest orthonormal matrix; a deviation above 1e-3 is
///    refused, as is everything else that problems(ImageGrid) reports.
///  - PNG: a pixel is 1 mm wide unless the file has an sCAL chunk, the origin is the centre of the top left pixel, y
///    points down. Colour becomes luminance (0.2125 R + 0.7154 G + 0.0721 B); transparency is refused.
///  - NRRD without a space: as LPS.
///
/// All functions throw InvalidInput for a suffix that format_from_suffix does not know, and FileError, naming the file,
/// when it is missing, damaged, of another dimension or kind than asked for, has more than 2^31 voxels, promises more
/// voxels than a file of its length can hold (found from the header, before memory is taken), or keeps its voxels in
/// another file. They read no other file than `path`. Samples that are not finite are passed on.

/// 2 or 3. Axes beyond the third count for nothing when they have one voxel; a 3-D image of one slice stays 3-D.
int image_dimension(const std::filesystem::path& path);

/// The grid alone, from the header.
template <int Dim>
ImageGrid<Dim> read_grid(const std::filesystem::path& path);

/// A scalar image of any pixel type.
template <int Dim>
Volume<Dim> read_volume(const std::filesystem::path& path);

/// An image of Dim components a voxel, taken as they are in the file: a displacement field has LPS world components.
template <int Dim>
VectorVolume<Dim> read_vector_volume(const std::filesystem::path& path);

}  // namespace saltus
