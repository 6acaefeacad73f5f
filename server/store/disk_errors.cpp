#include "server/store/disk_errors.h"

#include <sys/resource.h>

#include <cerrno>

namespace saltus::server {
namespace {

constexpr std::chrono::milliseconds kRoomRetry{60000};

}  // namespace

Refusal storage_full() {
  return {RefusalKind::Exhausted, "STORAGE_FULL",
          "the daemon's disk is full but for its reserve; free some space or delete old jobs", kRoomRetry};
}

Refusal file_too_large() {
  return {RefusalKind::FailedPrecondition, "FILE_TOO_LARGE",
          "the daemon may not write a file as large as this one (ulimit -f, or a limit of its file system); have that "
          "limit raised where it runs"};
}

void require_file_size(std::int64_t bytes) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_FSIZE, &limit) != 0) throw system_failure("cannot ask for the limit of a file's size");
  if (limit.rlim_cur != RLIM_INFINITY && bytes > 0 && static_cast<rlim_t>(bytes) > limit.rlim_cur)
    throw file_too_large();
}

std::system_error system_failure(const std::string& what) { return {errno, std::generic_category(), what}; }

void fail_write(StorageState& state, const std::string& what) {
  switch (errno) {
    case EIO:
    case EROFS:
    case ENXIO:
    case ENODEV:
    case ESTALE:
    case EUCLEAN:
      fail_sync(state, what);
    case ENOSPC:
    case EDQUOT:
      throw storage_full();
    case EFBIG:
      throw file_too_large();
    default:
      throw system_failure(what);
  }
}

void fail_sync(StorageState& state, const std::string& what) {
  if (errno == ENOSPC || errno == EDQUOT) throw storage_full();
  state.fail(system_failure(what).what());
  throw StorageState::refusal();
}

}  // namespace saltus::server
