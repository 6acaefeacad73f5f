#pragma once

#include "core/evaluation/statistics.h"
#include "core/grid/volume.h"

#include <optional>
#include <string>
#include <vector>

namespace saltus::report {

/// A place between two neighbouring voxels where the displacement jumps.
template <int Dim>
struct InterfaceFace {
  Index<Dim> voxel{};                        ///< the one before the face
  int axis = 0;                              ///< the other is one further along this grid axis
  Vector<Dim> jump = Vector<Dim>::Zero();    ///< of u across the face, world mm
  Vector<Dim> normal = Vector<Dim>::Zero();  ///< of the interface here, unit, world, from the first voxel's side
  double slip_mm = 0;                        ///< length of the jump's tangential part
  double opening_mm = 0;                     ///< normal part; negative: the sides close on each other
  double extent = 0;                         ///< area (length in 2-D) of interface that the face stands for, mm

  /// Continuous index of the middle of the face.
  Vector<Dim> middle() const;
};

template <int Dim>
struct DetectedInterface {
  std::vector<InterfaceFace<Dim>> faces;
  double threshold_mm = 0;               ///< least jump that was looked for
  double extent = 0;                     ///< of all faces, mm^(Dim-1)
  Statistics slip_mm, gap_mm;            ///< over the faces: slip_mm and |opening_mm|
  std::optional<Vector<Dim>> strongest;  ///< continuous index of the face whose surroundings slip most, one way
};

/// "12.3 cm²" or, in 2-D, "48 mm".
template <int Dim>
std::string extent_text(const DetectedInterface<Dim>& interface);

/// Finds where a displacement jumps between neighbouring voxels, from the field alone: a face counts when the change of
/// u across it is not explained by the slopes on its two sides, and is the largest along its axis. The jump is the
/// difference of the two sides, each carried on with its own slope to the face; one voxel between the sides may be a
/// mixture. A smooth motion, however steep, whose length of change is over two voxels has no such face. Normals are
/// those of planes fitted to the faces around, so that the steps of an oblique interface do not look like openings.
/// Faces that jump another way than those around them, or stand alone, are no interface and are left out.
///
/// Jumps below a fifth of the motion (its 99 % quantile) or a quarter of the least spacing are left out, and so is what
/// is within two voxels of the border.
template <int Dim>
DetectedInterface<Dim> detect_interface(const VectorVolume<Dim>& displacement);

}  // namespace saltus::report
