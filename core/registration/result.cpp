#include "core/registration/result.h"

namespace saltus {

std::string to_string(Termination termination) {
  switch (termination) {
    case Termination::Converged:
      return "converged";
    case Termination::Settled:
      return "energy settled";
    case Termination::NoiseFloor:
      return "only noise left";
    case Termination::IterationLimit:
      return "iteration limit";
    case Termination::LineSearchFailed:
      return "no further decrease";
    case Termination::Stopped:
      return "stopped";
    case Termination::NothingToRegister:
      return "nothing to register";
  }
  return "unknown";
}

bool is_plain(const RegistrationOptions::Momenta& momenta, const LevelSummary& level) {
  const double settled = momenta.settled_plain_shear;
  return level.was_plain || (settled > 0 && level.simple_shear >= settled);
}

double regularisation_beside(const RegistrationOptions::Momenta& momenta, const LevelSummary& level) {
  if (is_plain(momenta, level) && momenta.regularisation_beside_plain > 0) return momenta.regularisation_beside_plain;
  return momenta.regularisation_beside_first > 0 ? momenta.regularisation_beside_first : momenta.regularisation;
}

}  // namespace saltus
