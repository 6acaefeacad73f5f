#pragma once

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <string>

namespace saltus::cli {

/// Throws FileError when the file cannot be read or is not JSON.
nlohmann::json read_report(const std::filesystem::path& file);

/// The numbers of report.json that say at a glance how a registration went, one "name: value" a line.
/// What the report does not hold is left out.
std::string report_summary(const nlohmann::json& report);

}  // namespace saltus::cli
