#pragma once

#include <filesystem>
#include <string>

namespace saltus::worker {

/// Copies the blob from the daemon's own folder of blobs to `file`, if it is there with the right bytes. False when it
/// has to come over the connection: a folder that cannot be seen from here, or is not what it should be, costs time and
/// nothing else.
bool copy_shared_blob(const std::filesystem::path& blobs, const std::string& digest, const std::filesystem::path& file);

}  // namespace saltus::worker
