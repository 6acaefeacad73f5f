#pragma once

#include "server/worker/report/analysis.h"

#include <string>

namespace saltus::report {

/// The sections of the page that show pictures, as HTML: images, differences, displacement, Jacobian,
/// interface, momenta.
template <int Dim>
std::string figure_sections(const ReportInput<Dim>& input, const Analysis<Dim>& analysis);

}  // namespace saltus::report
