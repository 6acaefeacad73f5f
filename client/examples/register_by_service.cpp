// Sends two images to a daemon, follows the job and fetches what it made.
// Usage: register_by_service ADDRESS FIXED.mha MOVING.mha FOLDER
#include "client/lib/registration_client.h"

#include <filesystem>
#include <iostream>
#include <stdexcept>

int main(int argument_count, char** arguments) try {
  using namespace saltus;
  if (argument_count != 5)
    throw std::invalid_argument("usage: register_by_service ADDRESS FIXED.mha MOVING.mha FOLDER");
  client::RegistrationClient client({.address = arguments[1], .tls = {}, .retry = {}, .stop = {}});
  v1::RegistrationSpec spec;  // what is left open takes the server's defaults
  *spec.mutable_fixed() = client.upload_file(arguments[2], "mha");
  *spec.mutable_moving() = client.upload_file(arguments[3], "mha");
  spec.set_preset("fast");
  v1::RegistrationJob job = client.create(spec);
  job = client.watch(job.id(), [](const v1::RegistrationJob& now) {
    std::cerr << '\r' << static_cast<int>(100 * now.progress().fraction()) << " %  ";
  });
  if (job.state() != v1::JOB_STATE_SUCCEEDED) throw std::runtime_error(job.failure().message());
  std::filesystem::create_directories(arguments[4]);
  for (const v1::Artifact& artifact : job.artifacts())
    client.download(artifact, std::filesystem::path(arguments[4]) / artifact.name());
  std::cout << job.artifacts_size() << " files in " << arguments[4] << '\n';
} catch (const std::exception& error) {  // ClientError also has the server's reason, for programs
  std::cerr << error.what() << '\n';
  return 1;
}
