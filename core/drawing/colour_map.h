#pragma once

#include "core/drawing/raster.h"

namespace saltus::drawing {

/// Values are clipped to the map's range; a value that is not a number is mid grey.
Colour grey(double value);              ///< [0,1]: black to white
Colour sequential(double value);        ///< [0,1]: dark blue over green to yellow, even in lightness
Colour diverging(double value);         ///< [-1,1]: blue over near-white to red
Colour heat(double value);              ///< [0,1]: black over red to pale yellow
Colour interface_colour(double value);  ///< [0,1]: cyan over yellow to red, seen on any grey

inline constexpr Colour folded{190, 0, 190};  ///< where a Jacobian is not positive

/// `over` on `under` with opacity [0,1].
Colour blend(Colour under, Colour over, double opacity);

}  // namespace saltus::drawing
