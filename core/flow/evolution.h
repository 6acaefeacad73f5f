#pragma once

namespace saltus {

/// How initial momenta evolve along the flow phi, F = D phi.
///  Exact: Ad* of the total element; the geodesic of the paper's metric (EPDiff).
///  PerOrder: each m_i as a one-form density, m_i -> F^-T m_i, as the paper's equations read.
///  Carried: each momentum vector moves with its point and does not turn. A parallel shear flow then stays what it is.
///    Exact evolution turns momentum in a shear layer towards its normal; that force is a gradient, which in tissue
///    that hardly changes its volume is held by pressure, and which no image shows when its level lines cross the
///    layer.
enum class Evolution { Exact, PerOrder, Carried };

}  // namespace saltus
