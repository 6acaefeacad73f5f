#include "server/store/blob_directory.h"

#include "server/jobs/refusal.h"
#include "server/store/sha256.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <system_error>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kPrefix = "sha256:";
constexpr std::size_t kHexDigits = 64;
constexpr std::size_t kHashPiece = 1 << 20;

class FileDescriptor {
 public:
  explicit FileDescriptor(int descriptor) : descriptor_(descriptor) {}
  ~FileDescriptor() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return descriptor_; }

 private:
  int descriptor_;
};

[[noreturn]] void fail(const std::string& what) {
  if (errno == ENOSPC || errno == EDQUOT)
    throw Refusal(RefusalKind::Exhausted, "STORAGE_FULL",
                  "the daemon's disk is full; free some space or delete old jobs");
  throw std::system_error(errno, std::generic_category(), what);
}

void sync_folder(const fs::path& folder) {
  const FileDescriptor descriptor(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (descriptor.get() < 0 || fsync(descriptor.get()) != 0) fail("cannot sync " + folder.string());
}

Refusal corrupt(const std::string& digest) {
  return {RefusalKind::DataLoss, "BLOB_CORRUPT",
          "the stored bytes of " + digest + " are damaged; upload it again or run the job again"};
}

class FileUpload final : public BlobUpload {
 public:
  FileUpload(fs::path file, int descriptor, std::string digest, std::int64_t size)
      : file_(std::move(file)), descriptor_(descriptor), digest_(std::move(digest)), size_(size) {}
  ~FileUpload() override {
    if (!is_published_) ::unlink(file_.c_str());
  }

  const std::string& digest() const override { return digest_; }
  std::int64_t size() const override { return size_; }
  const fs::path& file() const { return file_; }
  bool is_sealed() const { return is_sealed_; }
  void set_published() { is_published_ = true; }

  void append(std::string_view bytes) override {
    if (static_cast<std::int64_t>(bytes.size()) > size_ - written_) throw wrong_size("more");
    hash_.add(bytes);
    written_ += static_cast<std::int64_t>(bytes.size());
    while (!bytes.empty()) {
      const ssize_t count = ::write(descriptor_.get(), bytes.data(), bytes.size());
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) fail("cannot write " + file_.string());
      bytes.remove_prefix(static_cast<std::size_t>(count));
    }
  }

  void seal() override {
    if (written_ != size_) throw wrong_size(std::to_string(written_));
    const std::string found = std::string(kPrefix) + hash_.hex();
    if (found != digest_)
      throw Refusal(
          RefusalKind::InvalidArgument, "DIGEST_MISMATCH",
          "digest is " + digest_ + ", but the bytes sent have " + found + "; send the bytes that belong to the digest");
    if (fsync(descriptor_.get()) != 0) fail("cannot sync " + file_.string());
    is_sealed_ = true;
  }

 private:
  Refusal wrong_size(const std::string& sent) const {
    return {RefusalKind::InvalidArgument, "SIZE_MISMATCH",
            "size is " + std::to_string(size_) + ", but " + sent + " bytes were sent; send the size of the whole blob"};
  }

  const fs::path file_;
  FileDescriptor descriptor_;
  const std::string digest_;
  const std::int64_t size_;
  std::int64_t written_ = 0;
  Sha256 hash_;
  bool is_sealed_ = false;
  bool is_published_ = false;
};

class FileReader final : public BlobReader {
 public:
  FileReader(int descriptor, std::string digest, std::int64_t size)
      : descriptor_(descriptor), digest_(std::move(digest)), size_(size) {}

  std::int64_t size() const override { return size_; }
  std::int64_t position() const override { return position_; }

  bool advance(std::int64_t target, std::int64_t budget) override {
    while (position_ < target && budget > 0) {
      const auto wanted = std::min<std::int64_t>({target - position_, budget, std::int64_t{kHashPiece}});
      budget -= static_cast<std::int64_t>(read(static_cast<std::size_t>(wanted)).size());
    }
    return position_ >= target;
  }

  std::string read(std::size_t limit) override {
    std::string bytes(
        static_cast<std::size_t>(std::min<std::int64_t>(static_cast<std::int64_t>(limit), size_ - position_)), '\0');
    std::size_t filled = 0;
    while (filled < bytes.size()) {
      const ssize_t count = ::read(descriptor_.get(), bytes.data() + filled, bytes.size() - filled);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) fail("cannot read " + digest_);
      if (count == 0) throw corrupt(digest_);
      filled += static_cast<std::size_t>(count);
    }
    hash_.add(bytes);
    position_ += static_cast<std::int64_t>(bytes.size());
    if (position_ == size_ && !is_checked_) {
      is_checked_ = true;
      if (std::string(kPrefix) + hash_.hex() != digest_) throw corrupt(digest_);
    }
    return bytes;
  }

 private:
  FileDescriptor descriptor_;
  const std::string digest_;
  const std::int64_t size_;
  std::int64_t position_ = 0;
  Sha256 hash_;
  bool is_checked_ = false;
};

}  // namespace

BlobDirectory::BlobDirectory(fs::path blobs, fs::path uploads)
    : blobs_(std::move(blobs)), uploads_(std::move(uploads)) {}

fs::path BlobDirectory::path_of(const std::string& digest) const {
  // The digest becomes a path, so its form is checked here whatever the caller has checked.
  const bool is_well_formed = digest.size() == kPrefix.size() + kHexDigits && digest.starts_with(kPrefix) &&
                              digest.find_first_not_of("0123456789abcdef", kPrefix.size()) == std::string::npos;
  if (!is_well_formed)
    throw Refusal(RefusalKind::InvalidArgument, "INVALID_FIELD",
                  "digest is '" + digest.substr(0, 80) + "'; it must be sha256: and 64 lower-case hex digits");
  return blobs_ / digest.substr(kPrefix.size(), 2) / digest.substr(kPrefix.size() + 2);
}

std::unique_ptr<BlobUpload> BlobDirectory::begin(const std::string& digest, std::int64_t size) {
  path_of(digest);
  std::string name = (uploads_ / "XXXXXX.part").string();
  const int descriptor = ::mkostemps(name.data(), 5, O_CLOEXEC);
  if (descriptor < 0) fail("cannot write in " + uploads_.string());
  return std::make_unique<FileUpload>(name, descriptor, digest, size);
}

void BlobDirectory::publish(BlobUpload& upload) {
  auto& file = dynamic_cast<FileUpload&>(upload);
  if (!file.is_sealed()) throw std::logic_error("an upload must be sealed before it is published");
  const fs::path target = path_of(file.digest());
  if (fs::create_directory(target.parent_path())) sync_folder(blobs_);
  if (::rename(file.file().c_str(), target.c_str()) != 0) fail("cannot rename to " + target.string());
  file.set_published();
  sync_folder(target.parent_path());
}

bool BlobDirectory::holds(const std::string& digest, std::int64_t size) const {
  std::error_code error;
  const auto found = fs::file_size(path_of(digest), error);
  return !error && static_cast<std::int64_t>(found) == size;
}

std::unique_ptr<BlobReader> BlobDirectory::open(const std::string& digest, std::int64_t size) {
  const fs::path path = path_of(digest);
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0 && errno != ENOENT) fail("cannot open " + path.string());
  if (descriptor < 0) throw corrupt(digest);
  auto reader = std::make_unique<FileReader>(descriptor, digest, size);
  if (!holds(digest, size)) throw corrupt(digest);
  return reader;
}

void BlobDirectory::remove(const std::string& digest) {
  const fs::path path = path_of(digest);
  if (::unlink(path.c_str()) != 0 && errno != ENOENT) fail("cannot remove " + path.string());
}

int BlobDirectory::remove_unknown(const std::function<bool(const std::string&)>& is_known) {
  int removed = 0;
  for (const auto& folder : fs::directory_iterator(blobs_)) {
    if (!folder.is_directory()) continue;
    for (const auto& entry : fs::directory_iterator(folder.path())) {
      const std::string digest =
          std::string(kPrefix) + folder.path().filename().string() + entry.path().filename().string();
      if (!is_known(digest)) removed += fs::remove(entry.path()) ? 1 : 0;
    }
  }
  return removed;
}

}  // namespace saltus::server
