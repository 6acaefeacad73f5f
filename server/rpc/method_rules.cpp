#include "server/rpc/method_rules.h"

#include <algorithm>

namespace saltus::server {
namespace {

constexpr auto None = Scope::None;
constexpr auto Own = Scope::Own;
constexpr auto All = Scope::All;

// A worker's calls need the lease token of its attempt besides. A digest is the key to its bytes: it is told with the
// job only, and nobody can guess it.
constexpr MethodRule kRules[] = {
    // method                                               reader submitter worker admin  change
    {"/saltus.v1.RegistrationService/CreateRegistrationJob", None, Own, None, All, true},
    {"/saltus.v1.RegistrationService/BatchCreateRegistrationJobs", None, Own, None, All, true},
    {"/saltus.v1.RegistrationService/GetRegistrationJob", All, Own, None, All, false},
    {"/saltus.v1.RegistrationService/ListRegistrationJobs", All, Own, None, All, false},
    {"/saltus.v1.RegistrationService/CancelRegistrationJob", None, Own, None, All, true},
    {"/saltus.v1.RegistrationService/DeleteRegistrationJob", None, Own, None, All, true},
    {"/saltus.v1.RegistrationService/WatchRegistrationJob", All, Own, None, All, false},

    {"/saltus.v1.BlobService/FindMissingBlobs", None, All, All, All, false},
    {"/saltus.v1.BlobService/WriteBlob", None, All, All, All, true},
    {"/saltus.v1.BlobService/ReadBlob", All, All, All, All, false},
    {"/saltus.v1.BlobService/QueryWriteStatus", None, All, All, All, false},

    {"/saltus.v1.ServerInfoService/GetServerInfo", All, All, All, All, false},

    {"/saltus.v1.WorkerService/AcquireLease", None, None, All, None, true},
    {"/saltus.v1.WorkerService/Heartbeat", None, None, All, None, false},
    {"/saltus.v1.WorkerService/PutCheckpoint", None, None, All, None, true},
    {"/saltus.v1.WorkerService/CompleteJob", None, None, All, None, true},
    // No change of its own: the lease that follows is one.
    {"/saltus.v1.WorkerService/TakeJob", None, None, All, None, false},
    {"/saltus.v1.WorkerService/ReportExit", None, None, All, None, true},

    {"/saltus.v1.AdminService/Drain", None, None, None, All, true},
    {"/saltus.v1.AdminService/CollectGarbage", None, None, None, All, true},
    {"/saltus.v1.AdminService/Fsck", None, None, None, All, false},

    {"/grpc.health.v1.Health/Check", All, All, All, All, false},
    {"/grpc.health.v1.Health/Watch", All, All, All, All, false},
    // For people at the machine, to find out what is served.
    {"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", None, None, None, None, false},
};

Scope scope_of(const MethodRule& rule, Role role) {
  switch (role) {
    case Role::Reader:
      return rule.reader;
    case Role::Submitter:
      return rule.submitter;
    case Role::Worker:
      return rule.worker;
    case Role::Admin:
      return rule.admin;
  }
  return Scope::None;
}

}  // namespace

std::span<const MethodRule> method_rules() { return kRules; }

const MethodRule* find_rule(std::string_view method) {
  const auto found =
      std::find_if(std::begin(kRules), std::end(kRules), [&](const MethodRule& rule) { return rule.method == method; });
  return found == std::end(kRules) ? nullptr : found;
}

Scope scope_of(const MethodRule& rule, const Roles& roles) {
  Scope widest = Scope::None;
  for (const Role role : roles) widest = std::max(widest, scope_of(rule, role));
  return widest;
}

}  // namespace saltus::server
