#pragma once

#include "client/lib/registration_client.h"

#include <filesystem>
#include <string>
#include <vector>

namespace saltus::cli {

/// Downloads the artefacts of a succeeded job into `folder`, which is made if need be. Throws ClientError,
/// LocalFileError, FileError. Returns the files' paths.
std::vector<std::filesystem::path> fetch_artifacts(client::RegistrationClient& client, const v1::RegistrationJob& job,
                                                   const std::filesystem::path& folder);

/// The exit code that a job in a terminal state amounts to; says on standard error what went wrong.
int exit_code_of(const v1::RegistrationJob& job);

}  // namespace saltus::cli
