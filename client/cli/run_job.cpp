#include "client/cli/run_job.h"

#include "client/cli/command.h"
#include "client/cli/job_output.h"
#include "client/cli/result_files.h"
#include "core/support/errors.h"

#include <iostream>

namespace saltus::cli {

std::vector<std::filesystem::path> fetch_artifacts(client::RegistrationClient& client, const v1::RegistrationJob& job,
                                                   const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw FileError("--out is " + folder.string() + ", which cannot be made: " + error.message());
  const bool had_result = holds_result(folder);
  // From here on what is there is no longer what a list has made.
  if (is_marked_done(folder)) std::filesystem::remove(folder / done_file, error);
  if (error) throw FileError((folder / done_file).string() + " cannot be removed: " + error.message());
  std::vector<std::filesystem::path> files;
  std::vector<std::string> names;
  for (const v1::Artifact& artifact : job.artifacts()) {
    const std::filesystem::path name = artifact.name();
    // The names come over the wire; one that leaves the folder is never followed.
    if (name.empty() || name != name.filename() || name == "." || name == "..")
      throw client::ClientError(
          grpc::StatusCode::DATA_LOSS, "BAD_ARTIFACT_NAME",
          "the server offers an artefact called " + artifact.name() + ", which is not a file name");
    client.download(artifact, folder / name);
    files.push_back(folder / name);
    names.push_back(name);
  }
  // Only now that all of the new result is there.
  for (const std::filesystem::path& file :
       had_result ? outdated_files(folder, names) : std::vector<std::filesystem::path>()) {
    std::filesystem::remove(file, error);
    if (error)
      throw FileError("the new result is in " + folder.string() + ", but " + file.string() +
                      " of an earlier one cannot be removed (" + error.message() + "); remove it");
    std::cerr << "removed " << file.string() << ", which is of an earlier result" << std::endl;
  }
  return files;
}

int exit_code_of(const v1::RegistrationJob& job, const std::string& pair) {
  if (job.state() == v1::JOB_STATE_SUCCEEDED) return Done;
  std::cerr << "saltus: " << (pair.empty() ? "" : "pair " + pair + ": ") << failure_line(job) << std::endl;
  return job.state() == v1::JOB_STATE_CANCELLED ? Cancelled : JobFailed;
}

}  // namespace saltus::cli
