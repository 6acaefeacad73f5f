#include "server/rpc/authorisation.h"

#include "server/jobs/refusal.h"
#include "server/rpc/call_interceptor.h"

#include <grpc/grpc_security_constants.h>

#include <vector>

namespace saltus::server {
namespace {

std::vector<std::string> names_of(const grpc::AuthContext& context) {
  const auto values = [&](const char* property) {
    std::vector<std::string> names;
    for (const grpc::string_ref& value : context.FindPropertyValues(property))
      if (!value.empty()) names.emplace_back(value.data(), value.size());
    return names;
  };
  auto names = values(GRPC_X509_SAN_PROPERTY_NAME);
  return names.empty() ? values(GRPC_X509_CN_PROPERTY_NAME) : names;
}

grpc::Status denied(const Caller& caller, std::string_view method) {
  std::string roles;
  for (const Role role : caller.roles) roles += (roles.empty() ? "" : ", ") + to_string(role);
  return {grpc::StatusCode::PERMISSION_DENIED,
          "'" + caller.identity + "' (" + (roles.empty() ? "without a role" : roles) + ") may not call " +
              std::string(method) + "; an administrator can change the daemon's roles file"};
}

/// gRPC 1.51 sends nothing but code and sentence for a call that is refused here, so the reason for programs ends the
/// sentence.
grpc::Status with_reason(const grpc::Status& status, const std::string& reason) {
  return {status.error_code(), status.error_message() + " [" + reason + "]"};
}

class Gate final : public grpc::AuthMetadataProcessor {
 public:
  explicit Gate(Authorisation authorisation) : authorisation_(std::move(authorisation)) {}

  bool IsBlocking() const override { return false; }

  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext* context, OutputMetadata*,
                       OutputMetadata*) override {
    const auto path = metadata.find(":path");
    const std::string_view method =
        path == metadata.end() ? std::string_view() : std::string_view(path->second.data(), path->second.size());
    const Caller caller = context ? authorisation_.remote_caller(*context) : Caller{"", {}, false};
    // gRPC takes an empty name for one, too.
    if (!context || !context->IsPeerAuthenticated() || caller.identity.empty()) {
      const grpc::Status status = with_reason(
          {grpc::StatusCode::UNAUTHENTICATED, "the certificate names nobody; give it an alternative or common name"},
          "NO_IDENTITY");
      authorisation_.tell_denied(caller, method, status);
      return status;
    }
    if (caller.scope(method) != Scope::None) return grpc::Status::OK;
    const grpc::Status status = with_reason(denied(caller, method), "ROLE_LACKS_RIGHT");
    authorisation_.tell_denied(caller, method, status);
    return status;
  }

 private:
  const Authorisation authorisation_;
};

}  // namespace

std::string Caller::limited_as() const { return is_local || roles.contains(Role::Worker) ? "" : identity; }

Scope Caller::scope(std::string_view method) const {
  const MethodRule* rule = find_rule(method);
  if (!rule) return Scope::None;
  return is_local ? Scope::All : scope_of(*rule, roles);
}

std::optional<std::string> Caller::confined_to(std::string_view method) const {
  switch (scope(method)) {
    case Scope::None:
      break;
    case Scope::Own:
      return identity;
    case Scope::All:
      return std::nullopt;
  }
  throw Refusal(RefusalKind::PermissionDenied, "ROLE_LACKS_RIGHT", denied(*this, method).error_message());
}

Caller Authorisation::remote_caller(const grpc::AuthContext& context) const {
  Caller caller{"", {}, false};
  for (const std::string& name : names_of(context)) {
    if (caller.identity.empty()) caller.identity = name;
    const auto roles = roles_ ? roles_->roles_of(name) : std::nullopt;
    if (!roles) continue;
    caller.identity = name;
    caller.roles = *roles;
    break;
  }
  return caller;
}

Caller Authorisation::caller_of(const grpc::ServerContextBase& context) const {
  const auto connection = context.auth_context();
  if (!connection) return {};
  for (const grpc::string_ref& type : connection->FindPropertyValues(GRPC_TRANSPORT_SECURITY_TYPE_PROPERTY_NAME))
    if (type != "insecure") return remote_caller(*connection);
  return {};
}

void Authorisation::tell_denied(const Caller& caller, std::string_view method, const grpc::Status& status) const {
  if (!observer_) return;
  const MethodRule* rule = find_rule(method);
  CallRecord call;
  // Not what a stranger has made up: it would go into logs and metrics.
  call.method = rule ? std::string(method) : "unknown";
  call.identity = caller.identity;
  call.is_local = false;
  call.is_change = rule && rule->is_change;
  call.code = to_string(status.error_code());
  observer_->denied(call);
}

std::shared_ptr<grpc::AuthMetadataProcessor> Authorisation::gate() const { return std::make_shared<Gate>(*this); }

}  // namespace saltus::server
