// Who gets in, and what may he do? Over real connections with mutual TLS.
#include "core/support/errors.h"
#include "tests/integration/server/daemon_test.h"
#include "tests/integration/server/generic_call.h"

#include "saltus/v1/admin.pb.h"
#include "tests/support/certificates.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <grpcpp/security/credentials.h>

#include <map>
#include <set>

namespace saltus::server {
namespace {

using testing_support::Authority;
using testing_support::Certificate;

class Access : public testing_support::DaemonTest {
 protected:
  void serve(const std::string& roles) {
    job_settings.slots = 1;
    write_server_certificate(authority.server());
    folder.write("ca.pem", authority.root.pem());
    folder.write("roles", roles);
    tune = [this](DaemonSettings& settings) {
      settings.protected_listen = {{ListenAddress::Kind::Protected, "", "127.0.0.1", 0}};
      settings.tls = {folder / "server.pem", folder / "server.key", folder / "ca.pem", std::chrono::seconds(1)};
      settings.roles = folder / "roles";
    };
    start();
    address = daemon->protected_addresses().at(0);
  }
  void write_server_certificate(const Certificate& certificate) {
    folder.write("server.pem", certificate.pem());
    folder.write("server.key", certificate.key_pem());
  }

  std::shared_ptr<grpc::Channel> channel_of(const std::shared_ptr<grpc::ChannelCredentials>& credentials) const {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    return grpc::CreateCustomChannel(address, credentials, arguments);
  }
  std::shared_ptr<grpc::Channel> channel_of(const Certificate& certificate) const {
    return channel_of(grpc::SslCredentials({authority.root.pem(), certificate.key_pem(), certificate.pem()}));
  }
  static grpc::Status info_over(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::ClientContext context;
    v1::ServerInfo answer;
    return v1::ServerInfoService::NewStub(channel)->GetServerInfo(&context, {}, &answer);
  }

  /// Sends one empty message, and hangs up when an answer comes.
  static grpc::Status call(const std::shared_ptr<grpc::Channel>& channel, const std::string& method) {
    return testing_support::call_by_name(channel, method, "", true).status;
  }

  Authority authority;
  std::string address;
};

/// Every method that this program can serve, from the descriptors of the protocol.
std::set<std::string> described_methods() {
  std::set<std::string> methods;
  std::set<const google::protobuf::FileDescriptor*> files;
  for (const auto* message :
       {v1::ServerInfo::descriptor(), v1::HeartbeatRequest::descriptor(), v1::DrainRequest::descriptor()})
    files.insert(message->file());
  for (const auto* file : files)
    for (int s = 0; s < file->service_count(); ++s)
      for (int m = 0; m < file->service(s)->method_count(); ++m)
        methods.insert("/" + file->service(s)->full_name() + "/" + file->service(s)->method(m)->name());
  return methods;
}

TEST(MethodRules, EveryMethodHasOneAndNoRuleIsLeftOver) {
  std::set<std::string> ruled;
  for (const MethodRule& rule : method_rules()) EXPECT_TRUE(ruled.insert(std::string(rule.method)).second);
  for (const std::string& method : described_methods())
    EXPECT_TRUE(ruled.erase(method) == 1) << method << " has no rule in server/rpc/method_rules.cpp";
  EXPECT_THAT(ruled, ::testing::ElementsAre("/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                                            "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"));
}

// Written out again on purpose: a right that is given by mistake needs two mistakes.
TEST_F(Access, EachRoleMayCallWhatTheTableGivesItAndNothingElse) {
  const std::string registration = "/saltus.v1.RegistrationService/";
  const std::string worker = "/saltus.v1.WorkerService/";
  const std::set<std::string> reader = {registration + "GetRegistrationJob",
                                        registration + "ListRegistrationJobs",
                                        registration + "WatchRegistrationJob",
                                        "/saltus.v1.BlobService/ReadBlob",
                                        "/saltus.v1.ServerInfoService/GetServerInfo",
                                        "/grpc.health.v1.Health/Check",
                                        "/grpc.health.v1.Health/Watch"};
  std::set<std::string> submitter = reader;
  submitter.insert({registration + "CreateRegistrationJob", registration + "BatchCreateRegistrationJobs",
                    registration + "CancelRegistrationJob", registration + "DeleteRegistrationJob",
                    "/saltus.v1.BlobService/FindMissingBlobs", "/saltus.v1.BlobService/WriteBlob",
                    "/saltus.v1.BlobService/QueryWriteStatus"});
  std::set<std::string> admin = submitter;
  admin.insert(
      {"/saltus.v1.AdminService/Drain", "/saltus.v1.AdminService/CollectGarbage", "/saltus.v1.AdminService/Fsck"});
  const std::set<std::string> for_workers = {worker + "AcquireLease",
                                             worker + "Heartbeat",
                                             worker + "PutCheckpoint",
                                             worker + "CompleteJob",
                                             worker + "TakeJob",
                                             worker + "ReportExit",
                                             "/saltus.v1.BlobService/FindMissingBlobs",
                                             "/saltus.v1.BlobService/WriteBlob",
                                             "/saltus.v1.BlobService/QueryWriteStatus",
                                             "/saltus.v1.BlobService/ReadBlob",
                                             "/saltus.v1.ServerInfoService/GetServerInfo",
                                             "/grpc.health.v1.Health/Check",
                                             "/grpc.health.v1.Health/Watch"};
  const std::map<std::string, std::set<std::string>> may = {
      {"reader", reader}, {"submitter", submitter}, {"worker", for_workers}, {"admin", admin}, {"nobody", {}}};
  serve("reader = reader\nsubmitter = submitter\nworker = worker\nadmin = admin\n");

  std::set<std::string> methods = described_methods();
  for (const MethodRule& rule : method_rules()) methods.insert(std::string(rule.method));
  methods.insert({"/saltus.v1.RegistrationService/DropAllTables", "/", "/saltus.v1.RegistrationService"});
  for (const auto& [name, allowed] : may) {
    const auto channel = channel_of(authority.issue(name));
    for (const std::string& method : methods) {
      const grpc::Status status = call(channel, method);
      if (allowed.contains(method))
        EXPECT_NE(status.error_code(), grpc::StatusCode::PERMISSION_DENIED) << name << " " << method;
      else
        EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED)
            << name << " " << method << " answered " << status.error_message();
      EXPECT_NE(status.error_code(), grpc::StatusCode::UNAVAILABLE) << name << " " << method;
    }
  }
}

TEST_F(Access, RefusesWhoeverHasNoCertificateOfTheAuthority) {
  serve("reader = reader\n");
  const Authority stranger;
  const Certificate expired(
      {.common_name = "reader", .alternative_names = "", .begins_after_seconds = -7200, .ends_after_seconds = -3600},
      &authority.root);
  const Certificate early(
      {.common_name = "reader", .alternative_names = "", .begins_after_seconds = 3600, .ends_after_seconds = 7200},
      &authority.root);
  const Certificate self_signed({.common_name = "reader", .alternative_names = ""});

  EXPECT_TRUE(info_over(channel_of(authority.issue("reader"))).ok());
  for (const Certificate& certificate : {std::cref(expired), std::cref(early), std::cref(self_signed)})
    EXPECT_EQ(info_over(channel_of(certificate)).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(info_over(channel_of(stranger.issue("reader"))).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(info_over(channel_of(grpc::SslCredentials({authority.root.pem(), "", ""}))).error_code(),
            grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(info_over(channel_of(grpc::InsecureChannelCredentials())).error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST_F(Access, ACertificateThatNamesNobodyIsNoIdentity) {
  serve("reader = reader\n");
  const grpc::Status status = info_over(channel_of(authority.issue("")));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAUTHENTICATED);
  EXPECT_THAT(status.error_message(), ::testing::EndsWith(" [NO_IDENTITY]"));
}

TEST_F(Access, AnAlternativeNameCountsBeforeTheCommonName) {
  serve(
      "dr.a@hospital.example = reader\nspiffe://hospital.example/b = reader\nC = D, the third = reader\nreader = "
      "reader\n");
  EXPECT_TRUE(info_over(channel_of(authority.issue("whoever", "email:dr.a@hospital.example"))).ok());
  EXPECT_TRUE(
      info_over(channel_of(authority.issue("", "DNS:pc7.hospital.example, URI:spiffe://hospital.example/b"))).ok());
  EXPECT_TRUE(info_over(channel_of(authority.issue("C = D, the third"))).ok());
  const grpc::Status status = info_over(channel_of(authority.issue("reader", "email:mallory@hospital.example")));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_THAT(status.error_message(), ::testing::HasSubstr("mallory@hospital.example"));
}

TEST_F(Access, LocalCallersNeedNoCertificate) {
  serve("reader = reader\n");
  EXPECT_TRUE(info_over(channel).ok());
}

/// What one caller gets when he asks for everything there is to ask about one job.
struct Answers {
  grpc::StatusCode get, watch, cancel, remove;
  std::vector<std::string> listed;
};

TEST_F(Access, ASubmitterHasOwnJobsOnlyAndDoesNotLearnOfOthers) {
  serve("a = submitter\nb = submitter\nc = submitter, reader\nreader = reader\nadmin = admin\n");
  const auto request = valid_request();
  const auto create_as = [&](const std::string& name) {
    grpc::ClientContext context;
    v1::RegistrationJob job;
    const auto stub = v1::RegistrationService::NewStub(channel_of(authority.issue(name)));
    const auto status = stub->CreateRegistrationJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job.id();
  };
  const auto ask_as = [&](const std::string& name, const std::string& id) {
    const auto stub = v1::RegistrationService::NewStub(channel_of(authority.issue(name)));
    Answers answers;
    {
      grpc::ClientContext context;
      v1::RegistrationJob job;
      v1::GetRegistrationJobRequest get;
      get.set_id(id);
      answers.get = stub->GetRegistrationJob(&context, get, &job).error_code();
    }
    {
      grpc::ClientContext context;
      v1::WatchRegistrationJobRequest watch;
      watch.set_id(id);
      const auto reader = stub->WatchRegistrationJob(&context, watch);
      v1::WatchRegistrationJobResponse event;
      if (reader->Read(&event)) context.TryCancel();
      answers.watch = reader->Finish().error_code();
    }
    {
      grpc::ClientContext context;
      v1::ListRegistrationJobsResponse list;
      EXPECT_EQ(stub->ListRegistrationJobs(&context, {}, &list).error_code(), grpc::StatusCode::OK);
      for (const auto& job : list.jobs()) answers.listed.push_back(job.id());
    }
    {
      grpc::ClientContext context;
      v1::RegistrationJob job;
      v1::CancelRegistrationJobRequest cancel;
      cancel.set_id(id);
      answers.cancel = stub->CancelRegistrationJob(&context, cancel, &job).error_code();
    }
    {
      grpc::ClientContext context;
      v1::DeleteRegistrationJobRequest remove;
      remove.set_id(id);
      v1::DeleteRegistrationJobResponse removed;
      answers.remove = stub->DeleteRegistrationJob(&context, remove, &removed).error_code();
    }
    return answers;
  };
  using enum grpc::StatusCode;
  using ::testing::ElementsAre;
  const std::string local = created().id();
  const std::string of_a = create_as("a");
  const std::string of_b = create_as("b");

  for (const std::string& id : {of_a, local, std::string("never-made")}) {
    const Answers b = ask_as("b", id);
    EXPECT_EQ(b.get, NOT_FOUND);
    EXPECT_EQ(b.watch, NOT_FOUND);
    EXPECT_EQ(b.cancel, NOT_FOUND);
    EXPECT_EQ(b.remove, NOT_FOUND);
    EXPECT_THAT(b.listed, ElementsAre(of_b));
  }
  EXPECT_EQ(get(of_a).state(), v1::JOB_STATE_QUEUED) << "somebody else's cancel must change nothing";

  const Answers reader = ask_as("reader", of_a);
  EXPECT_EQ(reader.get, OK);
  EXPECT_EQ(reader.watch, CANCELLED);  // by this client
  EXPECT_EQ(reader.cancel, PERMISSION_DENIED);
  EXPECT_EQ(reader.remove, PERMISSION_DENIED);
  EXPECT_THAT(reader.listed, ElementsAre(of_b, of_a, local));

  // Two roles: sees all, touches his own.
  const Answers both = ask_as("c", of_b);
  EXPECT_EQ(both.get, OK);
  EXPECT_EQ(both.cancel, NOT_FOUND);
  EXPECT_EQ(both.remove, NOT_FOUND);

  const Answers mine = ask_as("b", of_b);
  EXPECT_EQ(mine.get, OK);
  EXPECT_EQ(mine.cancel, OK);
  EXPECT_EQ(mine.remove, OK);
  const Answers admin = ask_as("admin", of_a);
  EXPECT_EQ(admin.get, OK);
  EXPECT_EQ(admin.cancel, OK);
  EXPECT_THAT(admin.listed, ElementsAre(of_a, local));
  EXPECT_EQ(get(local).state(), v1::JOB_STATE_RUNNING);
}

TEST_F(Access, RequestIdsOfTwoSubmittersAreTwo) {
  serve("a = submitter\nb = submitter\n");
  auto request = valid_request();
  request.set_request_id("today");
  std::set<std::string> ids;
  for (const char* name : {"a", "b", "a"}) {
    grpc::ClientContext context;
    v1::RegistrationJob job;
    const auto stub = v1::RegistrationService::NewStub(channel_of(authority.issue(name)));
    EXPECT_TRUE(stub->CreateRegistrationJob(&context, request, &job).ok());
    ids.insert(job.id());
  }
  EXPECT_EQ(ids.size(), 2u);
}

TEST_F(Access, RolesAreReadAgainWhenTheFileChanges) {
  serve("one = reader\n");
  const auto one = channel_of(authority.issue("one"));
  const auto two = channel_of(authority.issue("two"));
  EXPECT_TRUE(info_over(one).ok());
  EXPECT_EQ(info_over(two).error_code(), grpc::StatusCode::PERMISSION_DENIED);
  folder.write("roles", "two = reader, admin\n");
  while (!info_over(two).ok()) {
  }
  EXPECT_EQ(info_over(one).error_code(), grpc::StatusCode::PERMISSION_DENIED);
}

TEST_F(Access, CertificatesAreReadAgainWhenTheFilesChange) {
  serve("reader = reader\n");
  const Certificate mine = authority.issue("reader");
  EXPECT_TRUE(info_over(channel_of(mine)).ok());
  // Of another authority, which nobody trusts but the client that asks now: from when on it gets in, the new one is
  // there.
  const Authority next;
  const auto channel_of_next = [&] {
    return channel_of(grpc::SslCredentials({next.root.pem(), mine.key_pem(), mine.pem()}));
  };
  EXPECT_EQ(info_over(channel_of_next()).error_code(), grpc::StatusCode::UNAVAILABLE);
  write_server_certificate(next.server());
  while (!info_over(channel_of_next()).ok()) {
  }
  EXPECT_EQ(info_over(channel_of(mine)).error_code(), grpc::StatusCode::UNAVAILABLE);

  // The clients' authority too.
  const Certificate new_client = next.issue("reader");
  const auto channel_of_new_client = [&] {
    return channel_of(grpc::SslCredentials({next.root.pem(), new_client.key_pem(), new_client.pem()}));
  };
  EXPECT_EQ(info_over(channel_of_new_client()).error_code(), grpc::StatusCode::UNAVAILABLE);
  folder.write("ca.pem", next.root.pem());
  while (!info_over(channel_of_new_client()).ok()) {
  }
  EXPECT_EQ(info_over(channel_of_next()).error_code(), grpc::StatusCode::UNAVAILABLE);
}

}  // namespace
}  // namespace saltus::server
