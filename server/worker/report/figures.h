#pragma once

#include "server/worker/report/report.h"

#include <string>

namespace saltus::report {

/// The sections of the page that show pictures, as HTML: images, differences, displacement, Jacobian, momenta.
template <int Dim>
std::string figure_sections(const ReportInput<Dim>& input);

}  // namespace saltus::report
