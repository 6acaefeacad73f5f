#include "tests/crash/synced_copy.h"

#include "core/support/failpoint.h"

#include <sqlite3.h>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

// A layer between SQLite and its own access to files (https://www.sqlite.org/vfs.html): every call goes on to that.

namespace saltus::crash {
namespace {

namespace fs = std::filesystem;

sqlite3_vfs* original = nullptr;
fs::path copies;

/// What was written to one file since it was last synced.
struct Unsynced {
  fs::path file, copy;
  bool is_new_name = false;  ///< SQLite syncs the folder, too, when it syncs the file for the first time
  bool is_whole = true;      ///< another process may have written before
  std::vector<std::pair<sqlite3_int64, int>> ranges;
};

/// SQLite gives the memory: this, and then what the original needs.
struct WatchedFile {
  sqlite3_file base;
  Unsynced* unsynced;  ///< nullptr: not watched
};

sqlite3_file* original_of(sqlite3_file* file) {
  return reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + sizeof(WatchedFile));
}
Unsynced* unsynced_of(sqlite3_file* file) { return reinterpret_cast<WatchedFile*>(file)->unsynced; }
const sqlite3_io_methods& methods_of(sqlite3_file* file) { return *original_of(file)->pMethods; }

void require(bool is_well) {
  if (!is_well) std::abort();
}

/// Through SQLite's own descriptor: to close another one would give up its locks.
void copy_range(sqlite3_file* file, int copy, sqlite3_int64 begin, sqlite3_int64 end) {
  std::vector<char> bytes(1 << 16);
  for (sqlite3_int64 at = begin; at < end;) {
    const auto count = static_cast<int>(std::min<sqlite3_int64>(end - at, static_cast<sqlite3_int64>(bytes.size())));
    require(methods_of(file).xRead(original_of(file), bytes.data(), count, at) == SQLITE_OK);
    require(::pwrite(copy, bytes.data(), static_cast<std::size_t>(count), at) == count);
    at += count;
  }
}

void copy_what_was_synced(sqlite3_file* file) {
  Unsynced& unsynced = *unsynced_of(file);
  sqlite3_int64 size = 0;
  require(methods_of(file).xFileSize(original_of(file), &size) == SQLITE_OK);
  const int copy = ::open(unsynced.copy.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  require(copy >= 0);
  if (unsynced.is_whole) unsynced.ranges.assign(1, {0, static_cast<int>(size)});
  for (const auto& [begin, count] : unsynced.ranges) copy_range(file, copy, begin, std::min(begin + count, size));
  require(::ftruncate(copy, size) == 0);
  ::close(copy);
  unsynced.ranges.clear();
  unsynced.is_whole = false;
  if (!std::exchange(unsynced.is_new_name, false)) return;
  std::vector<fs::path> removed;
  for (const auto& entry : fs::directory_iterator(copies))
    if (!fs::exists(unsynced.file.parent_path() / entry.path().filename())) removed.push_back(entry.path());
  for (const fs::path& path : removed) fs::remove(path);
}

int close_file(sqlite3_file* file) {
  delete unsynced_of(file);
  return methods_of(file).xClose(original_of(file));
}

int write_file(sqlite3_file* file, const void* bytes, int count, sqlite3_int64 at) {
  const int code = methods_of(file).xWrite(original_of(file), bytes, count, at);
  if (Unsynced* unsynced = unsynced_of(file)) unsynced->ranges.emplace_back(at, count);
  return code;
}

int sync_file(sqlite3_file* file, int flags) {
  if (!unsynced_of(file)) return methods_of(file).xSync(original_of(file), flags);
  SALTUS_FAILPOINT("database.sync.before");
  const int code = methods_of(file).xSync(original_of(file), flags);
  if (code == SQLITE_OK) copy_what_was_synced(file);
  SALTUS_FAILPOINT("database.sync.after");
  return code;
}

template <auto Method, class... Arguments>
int pass(sqlite3_file* file, Arguments... arguments) {
  return (methods_of(file).*Method)(original_of(file), arguments...);
}

using Methods = sqlite3_io_methods;
const Methods watched_methods = {
    2,
    close_file,
    pass<&Methods::xRead>,
    write_file,
    pass<&Methods::xTruncate>,
    sync_file,
    pass<&Methods::xFileSize>,
    pass<&Methods::xLock>,
    pass<&Methods::xUnlock>,
    pass<&Methods::xCheckReservedLock>,
    pass<&Methods::xFileControl>,
    pass<&Methods::xSectorSize>,
    pass<&Methods::xDeviceCharacteristics>,
    pass<&Methods::xShmMap>,
    pass<&Methods::xShmLock>,
    [](sqlite3_file* file) { methods_of(file).xShmBarrier(original_of(file)); },
    pass<&Methods::xShmUnmap>,
    nullptr,
    nullptr,
};

int open_file(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out_flags) {
  auto* watched = reinterpret_cast<WatchedFile*>(file);
  watched->base.pMethods = nullptr;
  watched->unsynced = nullptr;
  constexpr int logs = SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL;
  const bool is_new_log = name && (flags & logs) && !fs::exists(name);
  const int code = original->xOpen(original, name, original_of(file), flags, out_flags);
  if (code != SQLITE_OK) return code;
  if (name && (flags & (logs | SQLITE_OPEN_MAIN_DB)))
    watched->unsynced = new Unsynced{name, copies / fs::path(name).filename(), is_new_log, true, {}};
  watched->base.pMethods = &watched_methods;
  return code;
}

int delete_file(sqlite3_vfs*, const char* name, int is_synced) {
  const int code = original->xDelete(original, name, is_synced);
  if (code == SQLITE_OK && is_synced) fs::remove(copies / fs::path(name).filename());
  return code;
}

sqlite3_vfs layer;

}  // namespace

SyncedCopies::SyncedCopies(const fs::path& folder) {
  fs::create_directories(folder);
  copies = folder;
  original = sqlite3_vfs_find(nullptr);
  layer = *original;
  layer.zName = "saltus-watched";
  layer.szOsFile = original->szOsFile + static_cast<int>(sizeof(WatchedFile));
  layer.xOpen = open_file;
  layer.xDelete = delete_file;
  if (sqlite3_vfs_register(&layer, 1) != SQLITE_OK) throw std::runtime_error("SQLite's files cannot be watched");
}

SyncedCopies::~SyncedCopies() {
  sqlite3_vfs_register(original, 1);
  sqlite3_vfs_unregister(&layer);
}

namespace {

[[maybe_unused]] const std::unique_ptr<SyncedCopies> from_the_start = [] {
  const char* folder = std::getenv("SALTUS_SYNCED_COPY");
  return folder ? std::make_unique<SyncedCopies>(folder) : nullptr;
}();

}  // namespace

}  // namespace saltus::crash
