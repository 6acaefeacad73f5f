#include "tests/crash/power_cut.h"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <map>
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

  Losses cut() {
    Losses losses;
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
    return losses;
  }

 private:
  std::map<std::string, Content> files_;
  std::vector<Name> names_;  ///< that no sync of their folder came after, oldest first
};

}  // namespace

Losses cut_power(const fs::path& record) {
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
  const Losses losses = disk.cut();
  fs::remove(record);
  return losses;
}

}  // namespace saltus::crash
