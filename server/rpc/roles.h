#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>

namespace saltus::server {

/// What somebody from the network may be.
enum class Role {
  Reader,     ///< sees everything, changes nothing
  Submitter,  ///< submits jobs; sees, cancels and deletes those that he submitted himself
  Worker,     ///< runs jobs, under the lease token of the attempt
  Admin,      ///< does everything that a person may do
};
constexpr Role kAllRoles[] = {Role::Reader, Role::Submitter, Role::Worker, Role::Admin};

std::string to_string(Role role);

using Roles = std::set<Role>;
using RoleTable = std::map<std::string, Roles>;

/// Whoever comes over the unix socket or the unprotected loopback port; no certificate can carry this name.
constexpr const char* kLocalIdentity = "local";

/// One `IDENTITY = ROLE, ROLE ...` a line; the last `=` divides, `#` begins a comment line. Throws InvalidInput that
/// names `file` and the line.
RoleTable parse_roles(const std::string& text, const std::string& file);

/// The roles of certificates' identities, from a text file that may change while the daemon runs. Thread-safe.
class RolesFile {
 public:
  /// Reads the file. Throws InvalidInput when it cannot be read or has an error. `log` gets one line for each reload.
  RolesFile(std::filesystem::path file, std::function<void(const std::string& line)> log);

  /// Reads the file again when it has changed. A file with an error is logged and the roles stay as they are. Blocks.
  void reload_if_changed();
  /// Nothing when the file does not name the identity. Never blocks.
  std::optional<Roles> roles_of(const std::string& identity) const;

 private:
  struct Stamp {
    std::filesystem::file_time_type changed;
    std::uintmax_t size = 0;
    std::uint64_t node = 0;
    bool operator==(const Stamp&) const = default;
  };
  Stamp stamp() const;

  const std::filesystem::path file_;
  const std::function<void(const std::string&)> log_;
  Stamp read_;
  mutable std::mutex mutex_;
  RoleTable table_;
};

}  // namespace saltus::server
