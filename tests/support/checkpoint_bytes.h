#pragma once

#include "core/registration/checkpoint.h"

#include <memory>
#include <sstream>
#include <string>

namespace saltus {

/// What `make` writes.
inline std::string bytes_of(const MakeCheckpoint& make) {
  std::ostringstream out;
  make(out);
  return std::move(out).str();
}

inline std::string encoded(const Checkpoint& checkpoint, std::uint64_t job) {
  return bytes_of([&](std::ostream& out) { encode(checkpoint, job, out); });
}

inline Checkpoint decoded(const std::string& bytes, std::uint64_t job) {
  std::istringstream in(bytes);
  return decode(in, job);
}

/// Without bytes: no checkpoint.
inline OpenCheckpoint from(const std::string& bytes) {
  if (bytes.empty()) return {};
  return [bytes]() -> std::unique_ptr<std::istream> { return std::make_unique<std::istringstream>(bytes); };
}

}  // namespace saltus
