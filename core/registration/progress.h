#pragma once

#include <functional>

namespace saltus {

/// Where a running registration stands. Levels count from 1 (coarsest) to `levels` (finest).
struct Progress {
  int level = 0;
  int levels = 0;
  int iteration = 0;         ///< accepted iterations on this level
  int max_iterations = 0;    ///< of this level
  double energy = 0;         ///< of this level, the last accepted
  double similarity = 0;     ///< its similarity part
  double fraction = 0;       ///< of the expected work, in [0,1]
  double seconds_left = -1;  ///< estimate; -1 while unknown
};

enum class ProgressAnswer { Continue, Stop };

/// Called from the thread that called register_images, many times in each evaluation of the energy.
using ProgressCallback = std::function<ProgressAnswer(const Progress&)>;

}  // namespace saltus
