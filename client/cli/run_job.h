#pragma once

#include "client/lib/registration_client.h"

#include <filesystem>
#include <string>
#include <vector>

namespace saltus::cli {

/// Downloads the artefacts of a succeeded job into `folder`, which is made if need be; then removes what an earlier
/// result has left there (outdated_files). Throws ClientError, LocalFileError, FileError. Returns the files' paths.
std::vector<std::filesystem::path> fetch_artifacts(client::RegistrationClient& client, const v1::RegistrationJob& job,
                                                   const std::filesystem::path& folder);

/// The exit code that a job in a terminal state amounts to; says on standard error what went wrong, of a list with
/// `pair`.
int exit_code_of(const v1::RegistrationJob& job, const std::string& pair = "");

}  // namespace saltus::cli
