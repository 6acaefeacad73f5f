// Any bytes as a checkpoint, with a header that fits them, so that what lies behind the checksum is reached.
#include "core/support/errors.h"
#include "core/support/fingerprint.h"
#include "tests/support/checkpoint_bytes.h"

#include <cstdint>
#include <cstring>
#include <string>

namespace {

constexpr std::uint64_t job = 42;
constexpr std::size_t header_size = 40;

std::string with_header(const std::string& body) {
  // The layout is encode's: 24 bytes of magic, version and job, then size and checksum of the body.
  std::string blob = saltus::encoded(saltus::Checkpoint{}, job).substr(0, header_size) + body;
  saltus::Fingerprint fingerprint;
  fingerprint.add_bytes(body.data(), body.size());
  const std::uint64_t size = body.size(), checksum = fingerprint.value();
  std::memcpy(blob.data() + 24, &size, sizeof size);
  std::memcpy(blob.data() + 32, &checksum, sizeof checksum);
  return blob;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  for (const std::string& blob : {bytes, with_header(bytes)}) {
    try {
      const saltus::Checkpoint checkpoint = saltus::decoded(blob, job);
      // What is read is written the same.
      if (saltus::encoded(checkpoint, job).substr(header_size) != blob.substr(header_size)) __builtin_trap();
    } catch (const saltus::InvalidInput&) {
      // says so; nothing else may be thrown
    }
  }
  return 0;
}
