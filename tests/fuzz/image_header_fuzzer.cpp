// Any bytes as an image file, given to our own checks of it, which look before ITK does: each accepts or refuses with
// a FileError, and what is accepted keeps the promises that reading relies on. The first byte chooses the format.
// What ITK makes of files that pass is image_header_test's.
#include "core/image_io/meta_header.h"
#include "core/image_io/nifti_header.h"
#include "core/image_io/nrrd_header.h"
#include "core/image_io/payload_check.h"
#include "core/image_io/png_chunks.h"
#include "core/support/errors.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

namespace {

using namespace saltus;

void require(bool is_kept) {
  if (!is_kept) std::abort();
}

void try_meta(const std::filesystem::path& file, std::uint64_t size) {
  const MetaHeader header = read_meta_header(file);
  require(header.dimension >= 1 && header.dimension <= MetaHeader::most_dimensions);
  require(header.components >= 1 && header.components <= 16);
  require(header.data_offset <= size);
  std::uint64_t voxels = 1;
  for (int axis = 0; axis < header.dimension; ++axis) voxels *= header.size[static_cast<std::size_t>(axis)];
  const std::uint64_t numbers = voxels * static_cast<std::uint64_t>(header.components);
  require(voxels >= 1 && voxels <= std::uint64_t{1} << 31);
  require(header.voxel_bytes >= numbers && header.voxel_bytes <= 8 * numbers);
  // Whatever is promised, it is no more than a file of this size can be worth.
  require(numbers <= 1032 * size);
  if (header.is_text)
    check_text_payload(file, header.data_offset, numbers);
  else if (header.is_compressed)
    check_compressed_payload(file, header.data_offset, header.voxel_bytes, header.compressed_bytes);
  else
    require(header.data_offset + header.voxel_bytes <= size);
}

void try_nifti(const std::filesystem::path& file, std::uint64_t size) {
  const NiftiHeader header = read_nifti_header(file);
  require(header.dimension >= 0 && header.dimension <= 4);
  require(header.data_offset >= 348 && header.data_offset <= std::size_t{64} << 20);
  check_compressed_payload(file, 0, size);
}

void try_nrrd(const std::filesystem::path& file, std::uint64_t size) {
  const NrrdHeader header = read_nrrd_header(file);
  require(header.data_offset >= 8 && header.data_offset <= size);
  if (header.is_gzip) check_compressed_payload(file, header.data_offset, 100);
}

void try_png(const std::filesystem::path& file, std::uint64_t) { check_png_chunks(file); }

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr void (*tries[])(const std::filesystem::path&, std::uint64_t) = {try_meta, try_nifti, try_nrrd, try_png};
  // One file in memory for all runs.
  static const int descriptor = memfd_create("image", MFD_CLOEXEC);
  static const std::filesystem::path file = "/proc/self/fd/" + std::to_string(descriptor);
  if (size == 0) return 0;
  require(ftruncate(descriptor, 0) == 0);
  require(pwrite(descriptor, data + 1, size - 1, 0) == static_cast<ssize_t>(size - 1));
  try {
    tries[data[0] % std::size(tries)](file, size - 1);
  } catch (const FileError& error) {
    const std::string said = error.what();
    require(!said.empty() && said.find('\n') == std::string::npos);
  }
  return 0;
}
