#include "client/cli/statistics_json.h"

#include <nlohmann/json.hpp>

namespace saltus::cli {

nlohmann::json as_json(const Statistics& s) {
  return {{"n", s.n}, {"mean", s.mean}, {"sd", s.sd}, {"median", s.median}, {"p90", s.p90}, {"max", s.max}};
}

}  // namespace saltus::cli
