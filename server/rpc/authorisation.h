#pragma once

#include "server/rpc/call_record.h"
#include "server/rpc/method_rules.h"
#include "server/rpc/roles.h"

#include <grpcpp/security/auth_context.h>
#include <grpcpp/security/auth_metadata_processor.h>
#include <grpcpp/server_context.h>

#include <memory>
#include <optional>
#include <string>

namespace saltus::server {

/// Who makes a call.
struct Caller {
  std::string identity = kLocalIdentity;
  Roles roles;           ///< empty for a local caller
  bool is_local = true;  ///< over the unix socket or the unprotected loopback port: may do everything

  /// Whom the limits of one submitter are counted for; "" for those who have none: everybody on this machine, who are
  /// not told apart, and workers, who do what others have asked for.
  std::string limited_as() const;
  /// Whose uploads these are; "" for everybody on this machine.
  std::string owner() const { return is_local ? "" : identity; }
  /// How far this caller's right to `method` reaches; None when it has no rule.
  Scope scope(std::string_view method) const;
  /// Whose jobs `method` may touch: nothing means everybody's. Throws Refusal ROLE_LACKS_RIGHT when the caller has no
  /// right to the method at all.
  std::optional<std::string> confined_to(std::string_view method) const;
};

/// The gate: everybody who comes over TLS passes it before any of our code runs, and whatever has no rule in the table
/// is refused.
class Authorisation {
 public:
  /// Without a roles file only local callers get in. `observer` is told whom the gate turned away; it must outlive the
  /// server.
  explicit Authorisation(std::shared_ptr<const RolesFile> roles, CallObserver* observer = nullptr)
      : roles_(std::move(roles)), observer_(observer) {}

  /// The identity is the certificate's first subject alternative name (of all that are there, the first that the roles
  /// file names), or its common name when it has no alternative name. Never blocks.
  Caller remote_caller(const grpc::AuthContext& context) const;
  /// Local when the connection is not encrypted: only listeners on this machine may be so. Never blocks.
  Caller caller_of(const grpc::ServerContextBase& context) const;

  void tell_denied(const Caller& caller, std::string_view method, const grpc::Status& status) const;
  /// To be installed in the credentials of a TLS listener.
  std::shared_ptr<grpc::AuthMetadataProcessor> gate() const;

 private:
  std::shared_ptr<const RolesFile> roles_;
  CallObserver* observer_;
};

}  // namespace saltus::server
