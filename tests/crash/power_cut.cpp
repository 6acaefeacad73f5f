#include "tests/crash/power_cut.h"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace saltus::crash {
namespace fs = std::filesystem;
namespace {

/// What is on the disk of one file.
struct Content {
  std::uintmax_t synced = 0;
  bool is_dirty = false;
};

struct Name {
  std::string from, to;
};

class Disk {
 public:
  void write(const std::string& path, std::uintmax_t offset) {
    // What was there before the record began is on the disk. A file that begins anew under an old name, or was cut, has
    // no more than what is before this.
    Content& content = files_.try_emplace(path, Content{offset, true}).first->second;
    content.synced = std::min(content.synced, offset);
    content.is_dirty = true;
  }
  void sync(const std::string& path, std::uintmax_t size) {
    if (const auto found = files_.find(path); found != files_.end()) found->second = {size, false};  // not for folders
    // A folder has the names in it from now on.
    std::erase_if(names_, [&](const Name& name) { return fs::path(name.to).parent_path() == path; });
  }
  void name(const std::string& from, const std::string& to) {
    names_.push_back({from, to});
    const auto found = files_.find(from);
    if (found == files_.end()) return;
    files_[to] = found->second;
    files_.erase(from);
  }

  void cut(Losses& losses) {
    for (const auto& [path, content] : files_) {
      std::error_code gone;
      const std::uintmax_t size = fs::file_size(path, gone);
      if (gone || !content.is_dirty || size <= content.synced) continue;
      fs::resize_file(path, content.synced);
      ++losses.files;
    }
    for (auto name = names_.rbegin(); name != names_.rend(); ++name) {
      if (!fs::exists(name->to)) continue;
      if (name->from.empty()) {
        fs::remove_all(name->to);
      } else {
        // The name was recorded before it was given.
        if (fs::exists(name->from)) continue;
        fs::rename(name->to, name->from);
      }
      ++losses.names;
    }
  }

 private:
  std::map<std::string, Content> files_;
  std::vector<Name> names_;  ///< that no sync of their folder came after, oldest first
};

constexpr std::size_t sector = 512;

std::string content_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

/// Of a file that has `written` and was last synced as `synced`.
std::string sectors_of(const std::string& written, const std::string& synced, std::mt19937& generator) {
  const auto is_lucky = [&] { return std::uniform_int_distribution<int>(0, 1)(generator) == 0; };
  if (is_lucky()) return is_lucky() ? written : synced;
  std::string left = is_lucky() ? written : synced;
  for (std::size_t at = 0; at < left.size(); at += sector) {
    const std::string& from = is_lucky() ? written : synced;
    const std::size_t count = std::min(sector, left.size() - at);
    // What was never written of a longer file is zero.
    std::string bytes = at < from.size() ? from.substr(at, count) : "";
    bytes.resize(count);
    left.replace(at, count, bytes);
  }
  return left;
}

int different_sectors(const std::string& one, const std::string& other) {
  int count = 0;
  for (std::size_t at = 0; at < std::max(one.size(), other.size()); at += sector)
    count += at >= one.size() || at >= other.size() || one.compare(at, sector, other, at, sector) != 0;
  return count;
}

}  // namespace

void cut_power(const fs::path& record, Losses& losses) {
  Disk disk;
  std::ifstream in(record);
  for (std::string what, first, second;
       std::getline(in, what, '\t') && std::getline(in, first, '\t') && std::getline(in, second);) {
    if (what == "write")
      disk.write(second, std::stoull(first));
    else if (what == "sync")
      disk.sync(second, std::stoull(first));
    else if (what == "name")
      disk.name(first, second);
    else
      throw std::runtime_error("the record of the disk has a line that begins with " + what);
  }
  disk.cut(losses);
  fs::remove(record);
}

void cut_power_of_database(const fs::path& file, const fs::path& copies, std::mt19937& generator, Losses& losses) {
  // What processes share of the log in memory.
  fs::remove(file.string() + "-shm");
  for (const char* suffix : {"", "-wal", "-journal"}) {
    const fs::path path = file.string() + suffix, copy = copies / path.filename();
    if (!fs::exists(path) && !fs::exists(copy)) continue;
    const std::string written = content_of(path), synced = content_of(copy);
    if (written == synced) continue;
    const std::string left = sectors_of(written, synced, generator);
    losses.sectors += different_sectors(left, written);
    std::ofstream(path, std::ios::binary | std::ios::trunc) << left;
    std::ofstream(copy, std::ios::binary | std::ios::trunc) << left;
  }
}

}  // namespace saltus::crash
