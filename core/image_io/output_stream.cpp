#include "core/image_io/output_stream.h"

#include <isa-l/igzip_lib.h>

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>
#include <vector>

#include "core/support/errors.h"

namespace saltus {

struct OutputStream::Packer {
  isal_zstream stream;
  std::vector<std::uint8_t> work = std::vector<std::uint8_t>(ISAL_DEF_LVL1_DEFAULT);
  std::vector<std::uint8_t> packed = std::vector<std::uint8_t>(1 << 18);
};

OutputStream::OutputStream(const std::filesystem::path& path, Packing packing, std::string name, std::uint64_t offset)
    : name_(std::move(name)) {
  errno = 0;
  file_.open(path, offset > 0 ? std::ios::binary | std::ios::in : std::ios::binary);
  if (offset > 0) file_.seekp(static_cast<std::streamoff>(offset));
  if (!file_) fail();
  if (packing == Packing::Plain) return;
  packer_ = std::make_unique<Packer>();
  isal_deflate_init(&packer_->stream);
  packer_->stream.level = 1;
  packer_->stream.level_buf = packer_->work.data();
  packer_->stream.level_buf_size = static_cast<std::uint32_t>(packer_->work.size());
  packer_->stream.gzip_flag = IGZIP_GZIP;
}

OutputStream::~OutputStream() = default;

void OutputStream::write(std::span<const char> bytes) {
  if (!packer_) return put(bytes);
  constexpr std::size_t most = 1 << 20;  // the library counts in 32 bits
  for (; !bytes.empty(); bytes = bytes.subspan(std::min(most, bytes.size())))
    pack(bytes.first(std::min(most, bytes.size())), false);
}

void OutputStream::finish() {
  if (packer_) pack({}, true);
  errno = 0;
  file_.close();
  if (!file_) fail();
}

void OutputStream::pack(std::span<const char> bytes, bool is_end) {
  isal_zstream& stream = packer_->stream;
  // The library reads alone, whatever its type says.
  stream.next_in = reinterpret_cast<std::uint8_t*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<std::uint32_t>(bytes.size());
  stream.end_of_stream = is_end;
  std::vector<std::uint8_t>& packed = packer_->packed;
  do {
    stream.next_out = packed.data();
    stream.avail_out = static_cast<std::uint32_t>(packed.size());
    if (isal_deflate(&stream) != COMP_OK) throw FileError("cannot write " + name_ + ": compressing it failed");
    put({reinterpret_cast<const char*>(packed.data()), packed.size() - stream.avail_out});
  } while (is_end ? stream.internal_state.state != ZSTATE_END : stream.avail_out == 0 || stream.avail_in > 0);
}

void OutputStream::put(std::span<const char> bytes) {
  errno = 0;
  if (!file_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()))) fail();
}

void OutputStream::fail() const {
  const int code = errno;
  throw FileError("cannot write " + name_ + ": " +
                  (code != 0 ? std::generic_category().message(code) : "is the disk full?"));
}

}  // namespace saltus
