#include "server/store/upload_parts.h"

#include "core/support/failpoint.h"
#include "server/jobs/refusal.h"
#include "server/store/disk_errors.h"
#include "server/store/file_upload.h"
#include "server/store/sha256.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <regex>
#include <stdexcept>
#include <vector>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

// "sha256:" is left out of names: a colon means something to tools that copy files.
constexpr std::size_t kPrefixBytes = 7;

// 128 bits: nobody finds an identity with the hash of another's.
constexpr std::size_t kOwnerDigits = 32;

/// "" or the hash of the owner and a dot: what all files of one owner begin with.
std::string owner_prefix(const std::string& owner) {
  if (owner.empty()) return "";
  Sha256 hash;
  hash.add(owner);
  return hash.hex().substr(0, kOwnerDigits) + ".";
}

std::string name_of(const UploadPlan& plan) {
  return owner_prefix(plan.owner) + plan.id + "." + std::to_string(plan.size) + "." + plan.digest.substr(kPrefixBytes) +
         ".part";
}

/// In place of an id that nobody knows any more.
constexpr const char* kTakenBack = "_taken_back_";

bool can_be_continued(const std::string& name) {
  static const std::regex form(R"(([0-9a-f]{32}\.)?[A-Za-z0-9_-]{1,64}\.[0-9]{1,19}\.[0-9a-f]{64}\.part)");
  return std::regex_match(name, form);
}

WallTime modified(const struct stat& status) {
  const auto since_epoch =
      std::chrono::seconds(status.st_mtim.tv_sec) + std::chrono::nanoseconds(status.st_mtim.tv_nsec);
  return WallTime(std::chrono::duration_cast<std::chrono::milliseconds>(since_epoch));
}

Refusal offset_mismatch(const UploadPlan& plan, std::int64_t committed) {
  return {RefusalKind::Aborted, "OFFSET_MISMATCH",
          "write_offset is " + std::to_string(plan.offset) + ", but " + std::to_string(committed) +
              " bytes of this upload are safe; go on there, as QueryWriteStatus says"};
}

}  // namespace

UploadParts::UploadParts(fs::path folder, Disk& disk, StorageState& state, DiskReserve& reserve, const Clock& clock,
                         Limits limits)
    : folder_(std::move(folder)), disk_(disk), state_(state), reserve_(reserve), clock_(clock), limits_(limits) {
  load();
}

void UploadParts::load() {
  for (const auto& entry : fs::directory_iterator(folder_)) {
    struct stat status {};
    if (!can_be_continued(entry.path().filename()) || ::lstat(entry.path().c_str(), &status) != 0 ||
        !S_ISREG(status.st_mode)) {
      fs::remove_all(entry.path());
      continue;
    }
    add(entry.path().filename(), modified(status));
  }
}

/// Knows of all files that workers have put there, those of which nobody has spoken included.
void UploadParts::notice_all() {
  for (const auto& entry : fs::directory_iterator(folder_)) {
    const std::string name = entry.path().filename();
    const std::lock_guard lock(mutex_);
    struct stat status {};
    // One that is gone had its file removed or renamed: this is another one's.
    if (name.starts_with(kGivenId) && can_be_continued(name) && !is_known(name) &&
        ::lstat(entry.path().c_str(), &status) == 0 && S_ISREG(status.st_mode))
      insert(name, modified(status));
  }
}

/// Whether there is an upload of this name. To be called with the map locked.
bool UploadParts::is_known(const std::string& name) const {
  const auto known = parts_.find(name);
  return known != parts_.end() && !known->second->is_gone;
}

void UploadParts::add(const std::string& name, WallTime touched) {
  const std::lock_guard lock(mutex_);
  insert(name, touched);
}

/// To be called with the map locked.
void UploadParts::insert(const std::string& name, WallTime touched) {
  auto part = std::make_shared<UploadPart>();
  part->file = folder_ / name;
  part->is_kept = true;
  part->is_given = name.starts_with(kGivenId);
  part->committed.reset();
  part->touched = touched;
  parts_.insert_or_assign(name, std::move(part));
}

void UploadParts::take_back(const fs::path& file, const std::string& digest) {
  struct stat status {};
  if (::lstat(file.c_str(), &status) != 0) throw system_failure("cannot look at " + file.string());
  UploadPlan plan;
  plan.digest = digest;
  plan.size = status.st_size;
  plan.id = kTakenBack;
  const std::string name = name_of(plan);
  // What is no blob at all cannot be continued either.
  if (!S_ISREG(status.st_mode) || !can_be_continued(name)) {
    fs::remove_all(file);
    return;
  }
  if (disk_.rename(file.c_str(), (folder_ / name).c_str()) != 0) throw system_failure("cannot rename " + file.string());
  add(name, modified(status));
}

/// Gives the upload's name to the bytes that were taken back for it, if there are any.
void UploadParts::adopt(const UploadPlan& plan) {
  UploadPlan nameless = plan;
  nameless.id = kTakenBack;
  nameless.owner.clear();
  const std::lock_guard lock(mutex_);
  const auto found = parts_.find(name_of(nameless));
  const std::string name = name_of(plan);
  if (found == parts_.end() || parts_.contains(name)) return;
  const auto part = found->second;
  const std::lock_guard part_lock(part->mutex);
  if (part->is_gone || part->is_held || disk_.rename(part->file.c_str(), (folder_ / name).c_str()) != 0) return;
  part->file = folder_ / name;
  parts_.erase(found);
  parts_.emplace(name, part);
}

/// Knows of the file that a worker has put there for the upload, if there is one.
void UploadParts::notice(const UploadPlan& plan) {
  const std::string name = name_of(plan);
  if (!name.starts_with(kGivenId) || !can_be_continued(name)) return;
  const std::lock_guard lock(mutex_);
  if (is_known(name)) return;
  struct stat status {};
  if (::lstat((folder_ / name).c_str(), &status) == 0 && S_ISREG(status.st_mode)) insert(name, clock_.wall());
}

std::shared_ptr<UploadPart> UploadParts::find(const UploadPlan& plan) {
  adopt(plan);
  notice(plan);
  const std::lock_guard lock(mutex_);
  const auto found = parts_.find(name_of(plan));
  return found == parts_.end() ? nullptr : found->second;
}

std::shared_ptr<UploadPart> UploadParts::part_of(const UploadPlan& plan) {
  adopt(plan);
  notice(plan);
  make_room();
  const std::lock_guard lock(mutex_);
  const std::string name = name_of(plan);
  auto& part = parts_[name];
  if (!part) {
    part = std::make_shared<UploadPart>();
    part->file = folder_ / name;
    part->is_kept = true;
    part->is_given = name.starts_with(kGivenId);
    part->touched = clock_.wall();
  }
  return part;
}

/// Forgets what is gone; removes the part that was left longest when there are too many.
void UploadParts::make_room() {
  std::vector<std::shared_ptr<UploadPart>> parts;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, part] : parts_) parts.push_back(part);
  }
  std::vector<std::shared_ptr<UploadPart>> gone;
  std::shared_ptr<UploadPart> oldest;
  WallTime oldest_time = WallTime::max();
  for (const auto& part : parts) {
    const std::lock_guard lock(part->mutex);
    if (part->is_given && !part->is_held && is_missing(*part)) part->is_gone = true;
    if (part->is_gone) gone.push_back(part);
    if (part->is_gone || part->is_held || part->touched >= oldest_time) continue;
    oldest = part;
    oldest_time = part->touched;
  }
  if (parts.size() - gone.size() >= limits_.kept && oldest) {
    const std::lock_guard lock(oldest->mutex);
    if (!oldest->is_held) {
      remove(*oldest);
      gone.push_back(oldest);
    }
  }
  const std::lock_guard lock(mutex_);
  std::erase_if(parts_,
                [&](const auto& entry) { return std::find(gone.begin(), gone.end(), entry.second) != gone.end(); });
}

std::int64_t UploadParts::remove(UploadPart& part) {
  struct stat status {};
  const bool is_there = ::stat(part.file.c_str(), &status) == 0;
  if (::unlink(part.file.c_str()) != 0 && errno != ENOENT) fail_write(state_, "cannot remove " + part.file.string());
  part.is_gone = true;
  return is_there ? status.st_size : 0;
}

bool UploadParts::is_missing(const UploadPart& part) {
  struct stat status {};
  return ::lstat(part.file.c_str(), &status) != 0 && errno == ENOENT;
}

void UploadParts::sync(UploadPart& part, int descriptor) {
  if (disk_.sync_data(descriptor) == 0) return;
  const int reason = errno;
  ::unlink(part.file.c_str());
  part.is_gone = true;
  errno = reason;
  fail_sync(state_, "cannot sync " + part.file.string());
}

void UploadParts::learn_committed(UploadPart& part) {
  // Whoever is told what is safe means to go on from there.
  part.touched = clock_.wall();
  if (part.committed) return;
  const FileDescriptor descriptor(::open(part.file.c_str(), O_RDWR | O_CLOEXEC));
  if (descriptor.get() < 0 && errno == ENOENT) {  // whoever has put it there has taken it away
    part.is_gone = true;
    part.committed = 0;
    return;
  }
  struct stat status {};
  if (descriptor.get() < 0 || ::fstat(descriptor.get(), &status) != 0)
    fail_write(state_, "cannot open " + part.file.string());
  if (!part.is_given) sync(part, descriptor.get());
  part.committed = status.st_size;
}

std::unique_ptr<BlobUpload> UploadParts::begin(const UploadPlan& plan) {
  state_.require_writable();
  require_file_size(plan.size);  // before a byte is written: parts of what cannot end would fill the disk
  auto room = std::make_unique<DiskReserve::Claim>(reserve_, plan.size - plan.offset);
  if (plan.id.empty()) {
    if (plan.offset != 0) throw offset_mismatch(plan, 0);
    auto part = std::make_shared<UploadPart>();
    std::string name = (folder_ / "XXXXXX.part").string();
    FileDescriptor descriptor(::mkostemps(name.data(), 5, O_CLOEXEC));
    if (descriptor.get() < 0) fail_write(state_, "cannot write in " + folder_.string());
    part->file = name;
    return std::make_unique<FileUpload>(*this, part, std::move(descriptor), plan, std::move(room));
  }
  if (!can_be_continued(name_of(plan)))
    throw Refusal(RefusalKind::InvalidArgument, "INVALID_FIELD",
                  "upload_id must have 1 to 64 letters, digits, '-' and '_'");
  while (true) {
    const auto part = part_of(plan);
    const std::lock_guard lock(part->mutex);
    if (part->is_gone) continue;  // published or removed meanwhile
    learn_committed(*part);
    if (part->is_gone) continue;
    if (plan.offset != *part->committed) {
      if (is_missing(*part)) part->is_gone = true;  // nobody has written to it, and now nobody will
      throw offset_mismatch(plan, *part->committed);
    }
    const int how = O_RDWR | O_CLOEXEC | (plan.offset == 0 ? O_CREAT : 0);
    FileDescriptor descriptor(::open(part->file.c_str(), how, 0600));
    struct stat status {};
    if (descriptor.get() < 0 && errno == ENOENT && plan.offset > 0) {
      part->is_gone = true;
      continue;
    }
    if (descriptor.get() < 0 || ::fstat(descriptor.get(), &status) != 0)
      fail_write(state_, "cannot write " + part->file.string());
    // A file that has another name is somebody's: none of it is cut off.
    if (status.st_size < plan.offset || (status.st_size > plan.offset && status.st_nlink > 1)) {
      remove(*part);
      continue;
    }
    // What a cut stream has written beyond the last sync was promised to nobody.
    if (status.st_size > plan.offset && ::ftruncate(descriptor.get(), plan.offset) != 0)
      fail_write(state_, "cannot write " + part->file.string());
    ++part->turn;
    return std::make_unique<FileUpload>(*this, part, std::move(descriptor), plan, std::move(room));
  }
}

std::int64_t UploadParts::committed(const UploadPlan& plan) {
  const auto part = plan.id.empty() ? nullptr : find(plan);
  if (!part) return 0;
  const std::lock_guard lock(part->mutex);
  if (part->is_gone) return 0;
  learn_committed(*part);
  return *part->committed;
}

std::int64_t UploadParts::waiting_beside(const UploadPlan& plan) {
  const std::string prefix = owner_prefix(plan.owner), own_name = name_of(plan);
  std::vector<std::shared_ptr<UploadPart>> parts;
  {
    const std::lock_guard lock(mutex_);
    for (auto it = parts_.lower_bound(prefix); it != parts_.end() && it->first.starts_with(prefix); ++it)
      if (it->first != own_name || plan.id.empty()) parts.push_back(it->second);
  }
  std::int64_t bytes = 0;
  for (const auto& part : parts) {
    const std::lock_guard lock(part->mutex);
    struct stat status {};
    if (!part->is_gone && !part->is_held && ::stat(part->file.c_str(), &status) == 0) bytes += status.st_size;
  }
  return bytes;
}

void UploadParts::move(BlobUpload& upload, const fs::path& target) {
  auto& file = dynamic_cast<FileUpload&>(upload);
  if (!file.is_sealed_) throw std::logic_error("an upload must be sealed before it is published");
  UploadPart& part = *file.part_;
  const std::lock_guard lock(part.mutex);
  file.require_turn();
  if (disk_.rename(part.file.c_str(), target.c_str()) != 0) fail_write(state_, "cannot rename to " + target.string());
  part.is_gone = true;
}

BlobStore::Leftovers UploadParts::expire(std::chrono::milliseconds age) {
  notice_all();
  std::vector<std::shared_ptr<UploadPart>> parts;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, part] : parts_) parts.push_back(part);
  }
  BlobStore::Leftovers removed;
  const WallTime before = clock_.wall() - age;
  for (const auto& part : parts) {
    const std::lock_guard lock(part->mutex);
    if (part->is_given && !part->is_held && is_missing(*part)) part->is_gone = true;
    if (part->is_gone || part->is_held || part->touched > before) continue;
    SALTUS_FAILPOINT("expire.before");
    removed.bytes += remove(*part);
    SALTUS_FAILPOINT("expire.after");
    ++removed.count;
  }
  return removed;
}

int UploadParts::count() {
  std::vector<std::shared_ptr<UploadPart>> parts;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, part] : parts_) parts.push_back(part);
  }
  int count = 0;
  for (const auto& part : parts) {
    const std::lock_guard lock(part->mutex);
    const bool was_taken_away = part->is_given && !part->is_held && is_missing(*part);
    count += part->is_gone || was_taken_away ? 0 : 1;
  }
  return count;
}

}  // namespace saltus::server
