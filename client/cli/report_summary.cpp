#include "client/cli/report_summary.h"

#include "core/support/errors.h"

#include <nlohmann/json.hpp>

#include <fstream>

namespace saltus::cli {

nlohmann::json read_report(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw FileError(file.string() + " cannot be read");
  try {
    return nlohmann::json::parse(in);
  } catch (const nlohmann::json::parse_error& error) {
    throw FileError(file.string() + " is not JSON: " + error.what());
  }
}

std::string report_summary(const nlohmann::json& report) { return report.dump(2); }

}  // namespace saltus::cli
