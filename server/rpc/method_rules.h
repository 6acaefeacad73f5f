#pragma once

#include "server/rpc/roles.h"

#include <span>
#include <string_view>

namespace saltus::server {

/// How far a right reaches.
enum class Scope {
  None,
  Own,  ///< the jobs that the caller has submitted
  All,
};

/// Who may call a method. Callers on this machine may call all of them: the permissions of the socket are their gate.
struct MethodRule {
  std::string_view method;  ///< as on the wire: "/saltus.v1.RegistrationService/GetRegistrationJob"
  Scope reader, submitter, worker, admin;
  bool is_change;  ///< goes into the audit log
};

/// The whole table. What is not in it is refused.
std::span<const MethodRule> method_rules();
/// Null when there is no rule.
const MethodRule* find_rule(std::string_view method);

/// The widest scope that one of `roles` has.
Scope scope_of(const MethodRule& rule, const Roles& roles);

}  // namespace saltus::server
