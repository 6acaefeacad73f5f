#pragma once

#include "client/lib/channel.h"
#include "client/lib/checksum.h"

#include "saltus/v1/registration.grpc.pb.h"

#include <filesystem>
#include <memory>
#include <string>

namespace saltus::client {

/// Moves files to and from the daemon's blob store. Used by clients and by workers.
/// Thread-safe; each method blocks until it is done and throws ClientError or LocalFileError.
class BlobTransfer {
 public:
  BlobTransfer(std::shared_ptr<grpc::Channel> channel, CallSettings settings);

  /// Sends the file unless the daemon has its bytes already. 1 MiB messages; an upload that was cut goes on where its
  /// bytes are safe, also one of an earlier process of this user on this machine.
  FileDigest upload(const std::filesystem::path& file);

  /// The same for a file that nobody writes to any more, whose name is gone afterwards. Where CallSettings::blobs has a
  /// folder of uploads on the same file system, the daemon gets the file itself, and checks it as it checks what it is
  /// sent. `name`: letters, digits and '-', of this file alone among those that are given with the same
  /// SharedBlobs::given_as, so that others can tell whose what a killed program leaves there was.
  FileDigest give(const std::filesystem::path& file, const std::string& name);

  /// Writes the blob to `file`. The file appears under its name only when it is complete and its digest is right;
  /// a cut download goes on where it stopped. Every message is checked by its CRC-32C. Where CallSettings::blobs has
  /// it, it comes from there: copied and checked, or, when it is ours and on the same file system, as the file that the
  /// daemon checked when it stored it.
  void download(const std::string& digest, const std::filesystem::path& file);

 private:
  FileDigest send(const std::filesystem::path& file, const std::filesystem::path& uploads, const std::string& given_id);

  CallSettings settings_;
  std::unique_ptr<v1::BlobService::Stub> stub_;
};

}  // namespace saltus::client
