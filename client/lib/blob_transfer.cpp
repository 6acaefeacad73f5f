#include "client/lib/blob_transfer.h"

#include "client/lib/client_error.h"

#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

namespace saltus::client {
namespace {

constexpr std::size_t upload_chunk = 1 << 20;

/// A file that gets its name when it is complete; else nothing of it stays.
class PendingFile {
 public:
  explicit PendingFile(const std::filesystem::path& target) : target_(target) {
    static std::atomic<int> counter = 0;
    std::ostringstream name;
    name << '.' << target.filename().string() << '.' << getpid() << '.' << ++counter << ".part";
    name_ = target.parent_path() / name.str();
    descriptor_ = open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor_ < 0) fail();
  }
  ~PendingFile() {
    if (descriptor_ >= 0) close(descriptor_);
    if (!committed_) unlink(name_.c_str());
  }
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;

  void append(std::string_view data) {
    while (!data.empty()) {
      const ssize_t written = write(descriptor_, data.data(), data.size());
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) fail();
      data.remove_prefix(static_cast<std::size_t>(written));
    }
  }

  void commit() {
    if (close(std::exchange(descriptor_, -1)) != 0) fail();
    if (rename(name_.c_str(), target_.c_str()) != 0) fail();
    committed_ = true;
  }

 private:
  [[noreturn]] void fail() const {
    throw LocalFileError(target_.string() + " cannot be written: " + std::strerror(errno));
  }

  std::filesystem::path target_;
  std::string name_;
  int descriptor_ = -1;
  bool committed_ = false;
};

grpc::Status send_file(v1::BlobService::Stub& stub, grpc::ClientContext& context, const std::filesystem::path& file,
                       const FileDigest& what) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw LocalFileError(file.string() + " cannot be read: " + std::strerror(errno));
  v1::WriteBlobResponse response;
  auto writer = stub.WriteBlob(&context, &response);
  v1::WriteBlobRequest request;
  request.set_digest(what.digest);
  request.set_size(what.size);
  std::string buffer(upload_chunk, '\0');
  bool open = true;
  // The first message goes out even for an empty file. Write() is false when the daemon has answered early.
  do {
    in.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    request.set_data(buffer.data(), static_cast<std::size_t>(in.gcount()));
    open = writer->Write(request);
    request.clear_digest();
    request.clear_size();
  } while (open && in);
  if (open) writer->WritesDone();
  return writer->Finish();
}

}  // namespace

BlobTransfer::BlobTransfer(std::shared_ptr<grpc::Channel> channel, CallSettings settings)
    : settings_(std::move(settings)), stub_(v1::BlobService::NewStub(channel)) {}

FileDigest BlobTransfer::upload(const std::filesystem::path& file) {
  const FileDigest what = digest_of_file(file);
  v1::FindMissingBlobsRequest question;
  question.add_digests(what.digest);
  v1::FindMissingBlobsResponse answer;
  call(settings_, CallKind::Unary,
       [&](grpc::ClientContext& context, bool&) { return stub_->FindMissingBlobs(&context, question, &answer); });
  if (answer.missing().empty()) return what;
  call(settings_, CallKind::Stream,
       [&](grpc::ClientContext& context, bool&) { return send_file(*stub_, context, file, what); });
  return what;
}

void BlobTransfer::download(const std::string& digest, const std::filesystem::path& file) {
  PendingFile pending(file);
  Sha256 sha;
  std::int64_t offset = 0;
  std::optional<std::int64_t> size;
  call(settings_, CallKind::Stream, [&](grpc::ClientContext& context, bool& moved) {
    v1::ReadBlobRequest request;
    request.set_digest(digest);
    request.set_offset(offset);
    auto reader = stub_->ReadBlob(&context, request);
    v1::ReadBlobResponse response;
    while (reader->Read(&response)) {
      if (response.offset() != offset || crc32c(response.data()) != response.crc32c()) {
        context.TryCancel();
        throw ClientError(grpc::StatusCode::DATA_LOSS, "BYTES_CHANGED",
                          "the bytes of " + digest + " were changed on their way at offset " + std::to_string(offset));
      }
      pending.append(response.data());
      sha.add(response.data());
      offset += static_cast<std::int64_t>(response.data().size());
      size = response.size();
      moved = true;
    }
    const grpc::Status status = reader->Finish();
    if (status.ok() && size && offset < *size)
      return grpc::Status(grpc::StatusCode::UNAVAILABLE, "the download ended early");
    return status;
  });
  if (const std::string found = sha.digest(); found != digest)
    throw ClientError(grpc::StatusCode::DATA_LOSS, "DIGEST_MISMATCH",
                      "the bytes that arrived for " + digest + " have the digest " + found + "; try again");
  pending.commit();
}

}  // namespace saltus::client
