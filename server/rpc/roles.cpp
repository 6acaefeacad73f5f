#include "server/rpc/roles.h"

#include "core/support/errors.h"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

namespace saltus::server {
namespace {

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

Role parse_role(const std::string& word, const std::string& where) {
  for (const Role role : kAllRoles)
    if (word == to_string(role)) return role;
  throw InvalidInput(where + ": '" + word + "' is no role; use reader, submitter, worker or admin");
}

std::string content_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  if (stream) text << stream.rdbuf();
  if (!stream) throw InvalidInput("--roles is " + file.string() + ", which cannot be read: " + std::strerror(errno));
  return text.str();
}

}  // namespace

std::string to_string(Role role) {
  switch (role) {
    case Role::Reader:
      return "reader";
    case Role::Submitter:
      return "submitter";
    case Role::Worker:
      return "worker";
    case Role::Admin:
      return "admin";
  }
  return "";
}

RoleTable parse_roles(const std::string& text, const std::string& file) {
  RoleTable table;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    line = trimmed(line);
    if (line.empty() || line.front() == '#') continue;
    const std::string where = file + ", line " + std::to_string(number);
    const auto divider = line.rfind('=');
    const std::string identity = divider == std::string::npos ? "" : trimmed(line.substr(0, divider));
    if (identity.empty()) throw InvalidInput(where + ": write IDENTITY = ROLE, ROLE ...");
    if (identity == kLocalIdentity)
      throw InvalidInput(where +
                         ": 'local' means those who come over the unix socket; give the certificate another name");
    Roles roles;
    std::istringstream words(line.substr(divider + 1));
    for (std::string word; std::getline(words, word, ',');) roles.insert(parse_role(trimmed(word), where));
    if (roles.empty()) throw InvalidInput(where + ": no role is given; use reader, submitter, worker or admin");
    if (!table.emplace(identity, roles).second)
      throw InvalidInput(where + ": '" + identity + "' was given roles before; keep one line for each identity");
  }
  return table;
}

RolesFile::RolesFile(std::filesystem::path file, std::function<void(const std::string&)> log)
    : file_(std::move(file)), log_(std::move(log)), read_(stamp()), table_(parse_roles(content_of(file_), file_)) {}

RolesFile::Stamp RolesFile::stamp() const {
  struct ::stat status {};
  if (::stat(file_.c_str(), &status) != 0) return {};
  const auto changed = std::chrono::seconds(status.st_mtim.tv_sec) + std::chrono::nanoseconds(status.st_mtim.tv_nsec);
  return {
      std::filesystem::file_time_type(std::chrono::duration_cast<std::filesystem::file_time_type::duration>(changed)),
      static_cast<std::uintmax_t>(status.st_size), static_cast<std::uint64_t>(status.st_ino)};
}

void RolesFile::reload_if_changed() {
  const Stamp now = stamp();
  if (now == read_) return;
  // Taken before the file is read: what is written meanwhile is a change again.
  read_ = now;
  try {
    RoleTable table = parse_roles(content_of(file_), file_);
    {
      std::lock_guard lock(mutex_);
      table_ = std::move(table);
    }
    log_("roles were read again");
  } catch (const InvalidInput& error) {
    log_(std::string("roles stay as they were: ") + error.what());
  }
}

std::optional<Roles> RolesFile::roles_of(const std::string& identity) const {
  std::lock_guard lock(mutex_);
  const auto found = table_.find(identity);
  if (found == table_.end()) return std::nullopt;
  return found->second;
}

}  // namespace saltus::server
