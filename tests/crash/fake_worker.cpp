// A worker that speaks the whole protocol and computes nothing: as the real one, it fetches, puts checkpoints in
// safety, goes on from one, sends and completes. Jobs that are not for it go to the real one.
#include "client/lib/blob_transfer.h"
#include "client/lib/client_error.h"
#include "core/support/failpoint.h"
#include "server/worker/lease.h"
#include "server/worker/process_limits.h"
#include "tests/crash/fake_result.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

#include <unistd.h>

namespace saltus::crash {
namespace {

namespace fs = std::filesystem;

constexpr int steps = 3;

std::string content_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

std::string checkpoint_after(int step, const v1::RegistrationSpec& spec) {
  return std::to_string(step) + " " + fake_result(spec, "checkpoint");
}

client::FileDigest send(client::BlobTransfer& blobs, const fs::path& file, const std::string& content) {
  std::ofstream(file, std::ios::binary) << content;
  return blobs.upload(file);
}

int work(worker::Lease& lease, const std::string& server) {
  const v1::RegistrationSpec& spec = lease.terms().spec();
  client::BlobTransfer blobs(client::make_channel(server), lease.transfer_settings());
  const fs::path folder = std::getenv("TMPDIR");
  blobs.download(spec.fixed().digest(), folder / "fixed");
  blobs.download(spec.moving().digest(), folder / "moving");

  int step = 0;
  if (lease.terms().has_checkpoint()) {
    blobs.download(lease.terms().checkpoint().digest(), folder / "checkpoint");
    const std::string checkpoint = content_of(folder / "checkpoint");
    std::istringstream(checkpoint) >> step;
    if (checkpoint != checkpoint_after(step, spec)) {
      lease.complete_failure("WRONG_CHECKPOINT", "the checkpoint is of another job");
      return 0;
    }
  }
  for (; step < steps; ++step) {
    v1::JobProgress progress;
    progress.set_stage(v1::JOB_STAGE_OPTIMISING);
    progress.set_iteration(step + 1);
    lease.set_progress(progress);
    const client::FileDigest sent = send(blobs, folder / "checkpoint.new", checkpoint_after(step + 1, spec));
    v1::Checkpoint checkpoint;
    checkpoint.set_digest(sent.digest);
    checkpoint.set_size(sent.size);
    checkpoint.set_iteration(step + 1);
    lease.put_checkpoint(checkpoint, lease.stop_token());
    if (lease.stop_reason() == worker::StopReason::Cancelled) {
      lease.complete_cancelled();
      return 0;
    }
  }
  std::vector<v1::Artifact> artifacts;
  for (const char* name : fake_artifacts) {
    SALTUS_FAILPOINT("worker.upload.before");
    const client::FileDigest sent = send(blobs, folder / name, fake_result(spec, name));
    SALTUS_FAILPOINT("worker.upload.after");
    v1::Artifact artifact;
    artifact.set_name(name);
    artifact.set_digest(sent.digest);
    artifact.set_size(sent.size);
    artifacts.push_back(artifact);
  }
  lease.complete_success(artifacts);
  return 0;
}

/// Asks for the terms without a name, which leaves the lease to whoever comes with one.
bool is_fake(const worker::AttemptIdentity& identity) {
  const auto stub = v1::WorkerService::NewStub(client::make_channel(identity.server));
  v1::AcquireLeaseRequest request;
  request.set_job_id(identity.job_id);
  request.set_attempt(identity.attempt);
  request.set_token(identity.token);
  v1::AcquireLeaseResponse terms;
  grpc::ClientContext context;
  context.set_wait_for_ready(true);
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
  const grpc::Status status = stub->AcquireLease(&context, request, &terms);
  // The lease is asked for again by whoever goes on, and says what is wrong with it.
  return !status.ok() || terms.spec().output_format() == fake_format;
}

int run(int argument_count, char** arguments) {
  worker::AttemptIdentity identity;
  for (int i = 1; i + 1 < argument_count; i += 2) {
    const std::string option = arguments[i], value = arguments[i + 1];
    if (option == "--server") identity.server = value;
    if (option == "--job") identity.job_id = value;
    if (option == "--attempt") identity.attempt = std::stoi(value);
    if (option == "--token-file") std::ifstream(value) >> identity.token;
  }
  worker::prepare_process();
  if (!is_fake(identity)) {
    const std::string real = fs::read_symlink("/proc/self/exe").parent_path() / "saltus-worker-failpoints";
    execv(real.c_str(), arguments);
    std::cerr << real << " cannot be started" << std::endl;
    return 1;
  }
  worker::Lease lease(identity, [](worker::Lease&) { _exit(4); });
  try {
    return work(lease, identity.server);
  } catch (const client::ClientError& error) {
    if (error.code() == grpc::StatusCode::CANCELLED && lease.stop_reason() == worker::StopReason::Cancelled) {
      lease.complete_cancelled();
      return 0;
    }
    throw;
  }
}

}  // namespace
}  // namespace saltus::crash

int main(int argument_count, char** arguments) {
  try {
    return saltus::crash::run(argument_count, arguments);
  } catch (const std::exception& error) {
    std::cerr << error.what() << std::endl;
    return 1;
  }
}
