#pragma once

#include "core/flow/discontinuous/switching_sheet.h"
#include "core/slip/jump_elements.h"

#include <vector>

namespace saltus {

/// Switching sheets (flow/discontinuous/) of momenta that jump across planes of any orientation: the ridge of their
/// jump density, in charts within which it is a height over one axis, moved with the flow. A sample within
/// kObliqueCleanDistance of such a sheet holds a mixture of both sides, since elements lie on the sites around it and
/// have the width of a cell. `velocities`: v(t_k) at equally spaced nodes over [0,1]. Empty without elements.
template <int Dim>
std::vector<SwitchingSheet<Dim>> slip_sheets(const std::vector<JumpElements<Dim>>& elements,
                                             const Lattice<Dim>& velocity_lattice,
                                             const std::vector<Field<float>>& velocities,
                                             const SwitchingSheetOptions& options = {});

}  // namespace saltus
