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

}  // namespace saltus
