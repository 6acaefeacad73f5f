#pragma once

namespace saltus {

/// Calls plane(p) for p in [0, planes) in `Apart` rounds (p mod Apart), in parallel within a round. When a plane adds
/// to no more than `Apart` neighbouring planes, no two threads meet, and what a place receives always comes in the same
/// order.
template <int Apart, class Plane>
void for_planes_apart(int planes, Plane&& plane) {
  for (int round = 0; round < Apart; ++round) {
#pragma omp parallel for schedule(static)
    for (int p = round; p < planes; p += Apart) plane(p);
  }
}

}  // namespace saltus
