#include "client/cli/report_summary.h"

#include "core/support/errors.h"

#include <nlohmann/json.hpp>

#include <fstream>
#include <iomanip>
#include <sstream>

namespace saltus::cli {
namespace {

/// The number at `path`, e.g. "/jacobian/min", in three significant digits; "-" when the report does not have it.
std::string number_in(const nlohmann::json& report, const std::string& path, double factor = 1) {
  const nlohmann::json::json_pointer pointer(path);
  if (!report.contains(pointer) || !report.at(pointer).is_number()) return "-";
  std::ostringstream text;
  text << std::setprecision(3) << factor * report.at(pointer).get<double>();
  return text.str();
}

std::string word(const nlohmann::json& report, const std::string& name) {
  return report.contains(name) && report.at(name).is_string() ? report.at(name).get<std::string>() : "-";
}

}  // namespace

nlohmann::json read_report(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw FileError(file.string() + " cannot be read");
  try {
    return nlohmann::json::parse(in);
  } catch (const nlohmann::json::parse_error& error) {
    throw FileError(file.string() + " is not JSON: " + error.what());
  }
}

std::string report_summary(const nlohmann::json& report) {
  std::ostringstream text;
  const auto line = [&text](const std::string& name, const std::string& value) {
    text << std::left << std::setw(14) << name << value << '\n';
  };
  line("model", word(report, "model") + ", " + word(report, "similarity") + ", " + word(report, "preset"));
  line("ended", word(report, "termination") + " after " + number_in(report, "/seconds/wall") + " s (" +
                    number_in(report, "/seconds/cpu") + " s of CPU, " + number_in(report, "/peak_memory_bytes", 1e-6) +
                    " MB)");
  line("similarity",
       number_in(report, "/similarity_value/before") + " -> " + number_in(report, "/similarity_value/after"));
  if (report.contains("landmark_error_mm"))
    line("landmarks", number_in(report, "/landmark_error_mm/before/mean") + " -> " +
                          number_in(report, "/landmark_error_mm/after/mean") + " mm mean error");
  line("displacement", number_in(report, "/displacement_mm/mean") + " mm mean, " +
                           number_in(report, "/displacement_mm/max") + " mm at most");
  line("jacobian", number_in(report, "/jacobian/min") + " to " + number_in(report, "/jacobian/max") + ", " +
                       number_in(report, "/jacobian/share_not_positive", 100) + " % not positive");
  line("inverse", number_in(report, "/inverse_consistency_mm") + " mm median error");
  if (report.contains("notices"))
    for (const nlohmann::json& notice : report.at("notices")) line("notice", notice.get<std::string>());
  return text.str();
}

}  // namespace saltus::cli
