#include "server/store/blob_directory.h"

#include "core/support/failpoint.h"
#include "server/jobs/refusal.h"
#include "server/store/disk_errors.h"
#include "server/store/disk_record.h"
#include "server/store/file_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <string_view>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kPrefix = "sha256:";
constexpr std::size_t kHexDigits = 64;

}  // namespace

Disk& BlobDirectory::real_disk() {
  static Disk disk;
  return disk;
}

BlobDirectory::BlobDirectory(BlobFolders folders, StorageState& state, const Clock& clock, ReserveSettings reserve,
                             UploadParts::Limits limits, Disk& disk)
    : folders_(std::move(folders)),
      state_(state),
      disk_(disk),
      reserve_(disk, folders_.uploads, reserve),
      uploads_(folders_.uploads, disk, state, reserve_, clock, limits) {}

fs::path BlobDirectory::path_of(const std::string& digest) const {
  // The digest becomes a path, so its form is checked here whatever the caller has checked.
  const bool is_well_formed = digest.size() == kPrefix.size() + kHexDigits && digest.starts_with(kPrefix) &&
                              digest.find_first_not_of("0123456789abcdef", kPrefix.size()) == std::string::npos;
  if (!is_well_formed)
    throw Refusal(RefusalKind::InvalidArgument, "INVALID_FIELD",
                  "digest is '" + digest.substr(0, 80) + "'; it must be sha256: and 64 lower-case hex digits");
  return folders_.blobs / digest.substr(kPrefix.size(), 2) / digest.substr(kPrefix.size() + 2);
}

void BlobDirectory::sync_folder(const fs::path& folder) {
  const FileDescriptor descriptor(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (descriptor.get() < 0) throw system_failure("cannot open " + folder.string());
  if (disk_.sync(descriptor.get()) != 0) fail_sync(state_, "cannot sync " + folder.string());
}

std::unique_ptr<BlobUpload> BlobDirectory::begin(const UploadPlan& plan) {
  path_of(plan.digest);
  return uploads_.begin(plan);
}

std::int64_t BlobDirectory::committed(const UploadPlan& plan) {
  path_of(plan.digest);
  return uploads_.committed(plan);
}

void BlobDirectory::publish(BlobUpload& upload) {
  const fs::path target = path_of(upload.digest());
  state_.require_writable();
  if (::mkdir(target.parent_path().c_str(), 0777) == 0) {
    SALTUS_RECORD_NEW_NAME("", target.parent_path().c_str());
    sync_folder(folders_.blobs);
  } else if (errno != EEXIST) {
    fail_write(state_, "cannot make " + target.parent_path().string());
  }
  {
    const std::lock_guard lock(names_mutex_);
    uploads_.move(upload, target);
  }
  sync_folder(target.parent_path());
}

bool BlobDirectory::holds(const std::string& digest, std::int64_t size) const {
  std::error_code error;
  const auto found = fs::file_size(path_of(digest), error);
  return !error && static_cast<std::int64_t>(found) == size;
}

std::unique_ptr<BlobReader> BlobDirectory::open(const std::string& digest, std::int64_t size) {
  const fs::path path = path_of(digest);
  FileDescriptor descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (descriptor.get() < 0 && errno != ENOENT) throw system_failure("cannot open " + path.string());
  struct stat status {};
  if (descriptor.get() < 0 || ::fstat(descriptor.get(), &status) != 0 || status.st_size != size)
    throw blob_corrupt(digest);
  return std::make_unique<FileReader>(disk_, std::move(descriptor), digest, size,
                                      [this, digest](int file) { move_aside(digest, file); });
}

/// Where that fails, as on a disk that can only be read, the blob stays and is found damaged again.
void BlobDirectory::move_aside(const std::string& digest, int descriptor) {
  const std::lock_guard lock(names_mutex_);
  const fs::path path = path_of(digest);
  struct stat read {
  }, named{};
  if (::fstat(descriptor, &read) != 0 || ::stat(path.c_str(), &named) != 0) return;
  // A new upload may have taken the name meanwhile.
  if (read.st_ino != named.st_ino || read.st_dev != named.st_dev) return;
  if (::rename(path.c_str(), (folders_.corrupt / digest.substr(kPrefix.size())).c_str()) != 0) return;
}

void BlobDirectory::remove(const std::string& digest) {
  const fs::path path = path_of(digest);
  SALTUS_FAILPOINT("remove.before");
  if (::unlink(path.c_str()) != 0 && errno != ENOENT) fail_write(state_, "cannot remove " + path.string());
  SALTUS_FAILPOINT("remove.after");
}

int BlobDirectory::take_back_unknown(const std::function<bool(const std::string&)>& is_known) {
  // A daemon that was killed between making a folder and syncing its name has left one that publish would not sync.
  sync_folder(folders_.blobs);
  std::vector<std::pair<fs::path, std::string>> unknown;
  for (const auto& folder : fs::directory_iterator(folders_.blobs)) {
    if (!folder.is_directory()) continue;
    for (const auto& entry : fs::directory_iterator(folder.path())) {
      const std::string digest =
          std::string(kPrefix) + folder.path().filename().string() + entry.path().filename().string();
      if (is_known(digest)) continue;
      unknown.emplace_back(entry.path(), digest);
    }
  }
  for (const auto& [file, digest] : unknown) uploads_.take_back(file, digest);
  return static_cast<int>(unknown.size());
}

std::vector<std::string> BlobDirectory::named_before(WallTime before) {
  std::vector<std::string> digests;
  for (const auto& folder : fs::directory_iterator(folders_.blobs)) {
    if (!folder.is_directory()) continue;
    for (const auto& entry : fs::directory_iterator(folder.path())) {
      struct stat status {};
      if (::stat(entry.path().c_str(), &status) != 0) continue;  // removed meanwhile
      // The time of the last change is that of the renaming.
      const auto renamed =
          std::chrono::seconds(status.st_ctim.tv_sec) + std::chrono::nanoseconds(status.st_ctim.tv_nsec);
      if (WallTime(std::chrono::duration_cast<std::chrono::milliseconds>(renamed)) >= before) continue;
      digests.push_back(std::string(kPrefix) + folder.path().filename().string() + entry.path().filename().string());
    }
  }
  return digests;
}

int BlobDirectory::set_aside() {
  return static_cast<int>(std::distance(fs::directory_iterator(folders_.corrupt), fs::directory_iterator()));
}

}  // namespace saltus::server
