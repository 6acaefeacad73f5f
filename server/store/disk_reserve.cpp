#include "server/store/disk_reserve.h"

#include "server/store/disk_errors.h"

#include <algorithm>

namespace saltus::server {

DiskReserve::Claim::Claim(DiskReserve& reserve, std::int64_t bytes) : reserve_(reserve), left_(bytes) {
  const std::int64_t promised_before = reserve_.promised_.fetch_add(bytes);
  try {
    reserve_.require_room(promised_before + bytes);
  } catch (...) {
    reserve_.promised_ -= bytes;
    throw;
  }
}

void DiskReserve::Claim::use(std::int64_t bytes) {
  const std::int64_t used = std::min(bytes, left_);
  left_ -= used;
  reserve_.promised_ -= used;
}

void DiskReserve::require_room(std::int64_t bytes) const {
  DiskSpace space;
  if (disk_.space(folder_.c_str(), space) != 0)
    throw system_failure("cannot tell the free space of " + folder_.string());
  const auto share = static_cast<std::int64_t>(settings_.fraction * static_cast<double>(space.total));
  if (space.available - bytes < std::max(share, settings_.bytes)) throw storage_full();
}

}  // namespace saltus::server
