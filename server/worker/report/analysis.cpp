#include "server/worker/report/analysis.h"

#include "server/worker/report/slip_marks.h"

#include <algorithm>

namespace saltus::report {

template <int Dim>
Analysis<Dim> analyse(const ReportInput<Dim>& input) {
  const RegistrationResult<Dim>& result = *input.result;
  Analysis<Dim> found;
  found.landmarks = measure_landmarks(input);
  found.displacement = measure_displacement(result.displacement);
  found.jacobian = jacobian_statistics(result.jacobian);
  found.interface = detect_interface(result.displacement);
  // The share counts sites of the m_i alone.
  found.may_slide = std::any_of(result.momenta.begin(), result.momenta.end(), [&](const MomentumField<Dim>& field) {
    return field.axis == MomentumField<Dim>::kOriented ||
           (field.axis >= 0 && result.summary.active_first_order_share > 0);
  });
  found.slip = summarise(result.slip);
  found.strongest_slip = strongest_slip(result.slip, input.input->fixed.grid);
  found.folded = count_folded(result.jacobian, found.interface);
  found.share_beyond_moving = share_carried_beyond(result.displacement, input.input->moving.grid);
  return found;
}

template Analysis<2> analyse(const ReportInput<2>&);
template Analysis<3> analyse(const ReportInput<3>&);

}  // namespace saltus::report
