#pragma once

#include "core/support/errors.h"
#include "server/worker/registration_task.h"

#include <filesystem>
#include <string>

namespace saltus::worker {

/// Runs one part of the task; its errors become failures for `reason`. Messages lose the folders of this machine, which
/// mean nothing to the user and should not be known to him.
template <class Part>
auto attempt(const std::string& reason, const std::filesystem::path& folder, const Part& part) {
  const auto failure = [&folder](const std::string& why, std::string message) {
    const std::string prefix = folder.string() + "/";
    for (auto at = message.find(prefix); at != std::string::npos; at = message.find(prefix))
      message.erase(at, prefix.size());
    return TaskFailure(why, message);
  };
  try {
    return part();
  } catch (const FileError& error) {
    throw failure(reason, error.what());
  } catch (const InvalidInput& error) {
    throw failure(reason, error.what());
  }
}

}  // namespace saltus::worker
