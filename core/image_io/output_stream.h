#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>

namespace saltus {

/// A file that is written from its beginning to its end, plain or as one gzip member, whose end tells how large all of
/// it is: some readers take no other. Compressed at the fastest level, since more of it makes noise-like floats hardly
/// smaller. What is kept of what is to be written does not grow with it.
class OutputStream {
 public:
  enum class Packing { Plain, Gzip };

  /// `name` is what errors call the file. From an offset on a file that is there is written over. Throws FileError.
  OutputStream(const std::filesystem::path& path, Packing packing, std::string name, std::uint64_t offset = 0);
  ~OutputStream();

  /// Throws FileError.
  void write(std::span<const char> bytes);
  /// Nothing may be written after it. Without it the file is not whole. Throws FileError.
  void finish();

 private:
  struct Packer;
  void pack(std::span<const char> bytes, bool is_end);
  void put(std::span<const char> bytes);
  [[noreturn]] void fail() const;

  std::string name_;
  std::ofstream file_;
  std::unique_ptr<Packer> packer_;  ///< null: plain
};

}  // namespace saltus
