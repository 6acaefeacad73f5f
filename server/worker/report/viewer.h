#pragma once

#include "server/worker/report/analysis.h"
#include "server/worker/report/pictures.h"

#include <string>
#include <vector>

namespace saltus::report {

/// The part of the page that one can handle: every slice of the planes' three axes, as fixed, moving or registered
/// image, one swept or flickering over the other, checkerboard, differences, displacement, Jacobian. The volumes lie in
/// the page as PNG pictures, thinned to at most `most_voxels` each, and the script paints from them. Hidden until the
/// script runs. `#view=NAME` after the page's address opens it with that view, a name of the buttons' data-view.
template <int Dim>
std::string viewer_section(const ReportInput<Dim>& input, const Pictures<Dim>& pictures,
                           const std::vector<drawing::SlicePlane<Dim>>& planes);

/// What the browser may do with the page: show what is in it and run the viewer's script, which is told by its hash;
/// load nothing, send nothing. The content of a <meta http-equiv="Content-Security-Policy">.
std::string content_policy();

/// Of each volume in the page: about 3.5 MB of PNG for all of them at worst.
inline constexpr std::size_t most_voxels = 700'000;

}  // namespace saltus::report
