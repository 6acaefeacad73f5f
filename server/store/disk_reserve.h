#pragma once

#include "server/store/disk.h"

#include <atomic>
#include <cstdint>
#include <filesystem>

namespace saltus::server {

/// How much of the disk uploads must leave free, so that the database can go on: the larger of both.
struct ReserveSettings {
  double fraction = 0.05;  ///< of the file system
  std::int64_t bytes = std::int64_t{2} << 30;

  bool operator==(const ReserveSettings&) const = default;
};

/// Room on the disk for uploads that have begun, promised before their bytes come. Thread-safe.
class DiskReserve {
 public:
  DiskReserve(Disk& disk, std::filesystem::path folder, ReserveSettings settings)
      : disk_(disk), folder_(std::move(folder)), settings_(settings) {}

  /// Room that is kept for one upload; what was not used is given back on destruction. One thread at a time.
  class Claim {
   public:
    /// Throws Refusal STORAGE_FULL when `bytes`, beside all that was promised before, would touch the reserve.
    Claim(DiskReserve& reserve, std::int64_t bytes);
    ~Claim() { reserve_.promised_ -= left_; }
    Claim(const Claim&) = delete;
    Claim& operator=(const Claim&) = delete;
    void use(std::int64_t bytes);

   private:
    DiskReserve& reserve_;
    std::int64_t left_;
  };

  /// Throws Refusal STORAGE_FULL when `bytes` more would touch the reserve.
  void require_room(std::int64_t bytes = 0) const;

 private:
  Disk& disk_;
  const std::filesystem::path folder_;
  const ReserveSettings settings_;
  std::atomic<std::int64_t> promised_{0};
};

}  // namespace saltus::server
