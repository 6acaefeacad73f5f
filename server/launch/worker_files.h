#pragma once

#include "server/jobs/job.h"

#include <filesystem>
#include <string>

namespace saltus::server {

/// "job-attempt", the beginning of the names of an attempt's files.
std::string file_name_of(const AttemptKey& key);

/// A new file of mode 0600 with this text, in the place of one that is there. Throws std::runtime_error.
void write_secret(const std::filesystem::path& file, const std::string& text);

/// Removes the oldest files of the folder until there are `most`.
void keep_newest(const std::filesystem::path& folder, std::size_t most);

}  // namespace saltus::server
