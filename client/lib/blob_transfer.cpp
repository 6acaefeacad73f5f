#include "client/lib/blob_transfer.h"

#include "client/lib/client_error.h"
#include "proto/crc32c.h"

#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <optional>
#include <random>
#include <sstream>
#include <utility>

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

namespace saltus::client {
namespace {

constexpr std::size_t upload_chunk = 1 << 20;
constexpr std::string_view kPrefix = "sha256:";  // of digests

/// Of two files, one that neither has included.
bool has_same_attribute(const std::string& one, const std::string& other, const char* attribute) {
  char of_one[4096], of_other[sizeof of_one];
  const ssize_t length = lgetxattr(one.c_str(), attribute, of_one, sizeof of_one);
  const ssize_t other_length = lgetxattr(other.c_str(), attribute, of_other, sizeof of_other);
  return length == other_length &&
         (length <= 0 || std::memcmp(of_one, of_other, static_cast<std::size_t>(length)) == 0);
}

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

  /// As if nothing had been appended.
  void empty() {
    if (ftruncate(descriptor_, 0) != 0 || lseek(descriptor_, 0, SEEK_SET) < 0) fail();
  }

  /// Goes on as `source` itself, with the permissions of a new file. False, and nothing changed, where that is on
  /// another file system, has another name already (whoever wrote to one would change both), or belongs to others than
  /// a new file here.
  bool become(const std::filesystem::path& source) {
    const std::string linked = name_ + ".link";
    struct stat made {};
    struct stat found {};
    if (fstat(descriptor_, &made) != 0 || link(source.c_str(), linked.c_str()) != 0) return false;
    const bool is_alone = lstat(linked.c_str(), &found) == 0 && S_ISREG(found.st_mode) && found.st_nlink == 2;
    // What a folder gives its files beside permissions.
    const bool is_alike = found.st_uid == made.st_uid && found.st_gid == made.st_gid &&
                          has_same_attribute(name_, linked, "system.posix_acl_access") &&
                          has_same_attribute(name_, linked, "security.selinux");
    if (is_alone && is_alike && chmod(linked.c_str(), made.st_mode & 07777) == 0 &&
        rename(linked.c_str(), name_.c_str()) == 0)
      return true;
    unlink(linked.c_str());
    return false;
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

/// Where a daemon keeps a blob in its folder of blobs: ab/cdef... for sha256:abcdef... Empty for what is no digest.
std::filesystem::path place_of(const std::string& digest) {
  const std::string hex = digest.starts_with(kPrefix) ? digest.substr(kPrefix.size()) : "";
  if (hex.size() != 64 || hex.find_first_not_of("0123456789abcdef") != std::string::npos) return {};
  return std::filesystem::path(hex.substr(0, 2)) / hex.substr(2);
}

/// The blob's bytes in `file` from the daemon's own folder. False, and `file` empty, where they have to come over the
/// connection: a folder that cannot be seen from here, or is not what it should be, costs time and nothing else.
bool take_shared(const SharedBlobs& blobs, const std::string& digest, const std::stop_token& stop, PendingFile& file) {
  const std::filesystem::path place = place_of(digest);
  if (blobs.folder.empty() || place.empty()) return false;
  if (blobs.are_ours && file.become(blobs.folder / place)) return true;
  std::ifstream from(blobs.folder / place, std::ios::binary);
  if (!from) return false;
  Sha256 sha;
  std::string piece(upload_chunk, '\0');
  while (from) {
    if (stop.stop_requested())
      throw ClientError(grpc::StatusCode::CANCELLED, "STOPPED", "stopped while reading " + digest);
    from.read(piece.data(), static_cast<std::streamsize>(piece.size()));
    const std::string_view bytes(piece.data(), static_cast<std::size_t>(from.gcount()));
    sha.add(bytes);
    file.append(bytes);
  }
  if (from.eof() && sha.digest() == digest) return true;
  file.empty();
  return false;
}

std::string random_id() {
  std::random_device random;
  std::ostringstream id;
  for (int i = 0; i < 4; ++i) id << std::hex << std::setw(8) << std::setfill('0') << random();
  return id.str();
}

/// The same for the same bytes sent by the same user of the same machine, so that a later process goes on with what an
/// earlier one has left.
std::string lasting_id(const FileDigest& what) {
  char host[256] = {};
  if (gethostname(host, sizeof host - 1) != 0) return random_id();
  Sha256 sha;
  sha.add("upload\n" + std::string(host) + "\n" + std::to_string(getuid()) + "\n" + what.digest);
  return sha.digest().substr(kPrefix.size(), 32);
}

/// A second name for a file among the daemon's uploads, under which it is an upload whose bytes are all there. Gone
/// with this object, unless the daemon has made it the blob's.
class OfferedFile {
 public:
  /// Not where `uploads` is empty or cannot hold it.
  OfferedFile(const std::filesystem::path& file, const FileDigest& what, const std::filesystem::path& uploads,
              std::string id)
      : id_(std::move(id)) {
    if (uploads.empty()) return;
    name_ = uploads / (id_ + "." + std::to_string(what.size) + "." + what.digest.substr(kPrefix.size()) + ".part");
    if (link(file.c_str(), name_.c_str()) != 0) name_.clear();
  }
  ~OfferedFile() { withdraw(); }
  OfferedFile(const OfferedFile&) = delete;
  OfferedFile& operator=(const OfferedFile&) = delete;

  bool is_there() const { return !name_.empty(); }
  const std::string& id() const { return id_; }
  void withdraw() {
    if (is_there()) unlink(name_.c_str());
    name_.clear();
  }

 private:
  std::string id_;
  std::filesystem::path name_;
};

grpc::Status send_file(v1::BlobService::Stub& stub, grpc::ClientContext& context, const std::filesystem::path& file,
                       const FileDigest& what, const std::string& id, std::int64_t offset) {
  std::ifstream in(file, std::ios::binary);
  if (!in || !in.seekg(offset)) throw LocalFileError(file.string() + " cannot be read: " + std::strerror(errno));
  v1::WriteBlobResponse response;
  auto writer = stub.WriteBlob(&context, &response);
  v1::WriteBlobRequest request;
  request.set_digest(what.digest);
  request.set_size(what.size);
  request.set_upload_id(id);
  request.set_write_offset(offset);
  std::string buffer(upload_chunk, '\0');
  bool open = true;
  // The first message goes out even for an empty rest. Write() is false when the daemon has answered early.
  do {
    in.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    request.set_data(buffer.data(), static_cast<std::size_t>(in.gcount()));
    open = writer->Write(request);
    request.Clear();
  } while (open && in);
  if (open) writer->WritesDone();
  return writer->Finish();
}

}  // namespace

BlobTransfer::BlobTransfer(std::shared_ptr<grpc::Channel> channel, CallSettings settings)
    : settings_(std::move(settings)), stub_(v1::BlobService::NewStub(channel)) {}

FileDigest BlobTransfer::upload(const std::filesystem::path& file) { return send(file, {}, {}); }

FileDigest BlobTransfer::give(const std::filesystem::path& file, const std::string& name) {
  const FileDigest what = send(file, settings_.blobs.uploads, settings_.blobs.given_as + name);
  std::error_code error;
  if (!std::filesystem::remove(file, error) && error)
    throw LocalFileError(file.string() + " cannot be removed: " + error.message());
  return what;
}

FileDigest BlobTransfer::send(const std::filesystem::path& file, const std::filesystem::path& uploads,
                              const std::string& given_id) {
  const FileDigest what = digest_of_file(file);
  v1::FindMissingBlobsRequest question;
  question.add_digests(what.digest);
  v1::FindMissingBlobsResponse answer;
  call(settings_, CallKind::Unary,
       [&](grpc::ClientContext& context, bool&) { return stub_->FindMissingBlobs(&context, question, &answer); });
  if (answer.missing().empty()) return what;
  OfferedFile offered(file, what, uploads, given_id);
  std::string id = offered.is_there() ? offered.id() : lasting_id(what);
  v1::QueryWriteStatusResponse progress;
  const auto ask = [&] {
    v1::QueryWriteStatusRequest status_request;
    status_request.set_digest(what.digest);
    status_request.set_size(what.size);
    status_request.set_upload_id(id);
    call(settings_, CallKind::Unary,
         [&](grpc::ClientContext& query, bool&) { return stub_->QueryWriteStatus(&query, status_request, &progress); });
  };
  std::optional<std::int64_t> committed;
  call(settings_, CallKind::Stream, [&](grpc::ClientContext& context, bool& moved) {
    ask();
    // The daemon does not see it, or wants it no more. It must not find it later: it would cut it off where it says.
    if (offered.is_there() && !progress.complete() && progress.committed_size() != what.size) {
      offered.withdraw();
      id = lasting_id(what);
      ask();
    }
    if (progress.complete()) return grpc::Status::OK;
    moved = committed && progress.committed_size() > *committed;
    committed = progress.committed_size();
    const grpc::Status status = send_file(*stub_, context, file, what, id, *committed);
    if (status.ok()) return status;
    const std::string reason = error_of(status, context, settings_.address).reason();
    // Another process sends the same file. Whoever is second goes its own way, or they would take it from each other.
    if (reason == "UPLOAD_TAKEN_OVER") id = random_id();
    // What an earlier stream has left may be spoilt; the daemon has dropped it.
    if (reason == "DIGEST_MISMATCH" && *committed > 0) id = random_id();
    // The cut stream's last bytes have become safe meanwhile: ask again.
    if (reason == "UPLOAD_TAKEN_OVER" || reason == "OFFSET_MISMATCH" || (reason == "DIGEST_MISMATCH" && *committed > 0))
      return grpc::Status(grpc::StatusCode::UNAVAILABLE, status.error_message());
    return status;
  });
  return what;
}

void BlobTransfer::download(const std::string& digest, const std::filesystem::path& file) {
  PendingFile pending(file);
  if (take_shared(settings_.blobs, digest, settings_.stop, pending)) return pending.commit();
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
