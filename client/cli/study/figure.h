#pragma once

#include "core/drawing/raster.h"

#include <string>

namespace saltus::cli {

/// A picture of a study, as file and on its page.
struct Figure {
  std::string name;     ///< of the file, without ".png"
  std::string title;    ///< a few words
  std::string caption;  ///< what is seen, and how it was made
  drawing::Raster picture;
};

}  // namespace saltus::cli
