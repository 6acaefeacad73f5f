#pragma once

#include <filesystem>
#include <ostream>

namespace saltus::server {

/// Checks the data folder of a daemon that does not run, and writes what it finds, one line each, and a summary. True
/// when nothing is damaged. Throws std::runtime_error when the folder is in use or its database cannot be read.
bool check_data_folder(const std::filesystem::path& data, std::ostream& out);

}  // namespace saltus::server
