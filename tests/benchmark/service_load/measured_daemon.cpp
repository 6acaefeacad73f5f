#include "tests/benchmark/service_load/measured_daemon.h"

#include "tests/benchmark/service_load/client_calls.h"

#include <signal.h>

#include <stdexcept>

namespace saltus::benchmark {

void MeasuredDaemon::start() {
  std::vector<std::string> words{program_, "--data", folder_ / "data", "--log-level", "warning"};
  words.insert(words.end(), options_.begin(), options_.end());
  process_.emplace(words);
  const std::string said = "listening on ", line = process_->wait_for_output(said);
  address_ = line.substr(line.find(said) + said.size());
  channel_ = connect(address_);
  jobs_ = v1::RegistrationService::NewStub(channel_);
}

void MeasuredDaemon::kill() {
  process_->signal(SIGKILL);
  process_->wait();
}

void MeasuredDaemon::stop() {
  process_->signal(SIGTERM);
  if (process_->wait() != 0) throw std::runtime_error("the daemon did not stop in order");
}

void MeasuredDaemon::prepare(const std::string& fixed, const std::string& moving) {
  const auto blobs = v1::BlobService::NewStub(channel_);
  const auto add = [&](const std::string& data, v1::InputFile& file) {
    require(upload(*blobs, data), "upload");
    file.set_digest(digest_of(data));
    file.set_format("mha");
  };
  add(fixed, *request_.mutable_spec()->mutable_fixed());
  add(moving, *request_.mutable_spec()->mutable_moving());
}

std::string MeasuredDaemon::create() const {
  grpc::ClientContext context;
  v1::RegistrationJob job;
  require(jobs_->CreateRegistrationJob(&context, request_, &job), "create");
  return job.id();
}

void MeasuredDaemon::cancel(const std::string& id) const {
  grpc::ClientContext context;
  v1::CancelRegistrationJobRequest request;
  request.set_id(id);
  v1::RegistrationJob job;
  require(jobs_->CancelRegistrationJob(&context, request, &job), "cancel");
}

}  // namespace saltus::benchmark
