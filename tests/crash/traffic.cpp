#include "tests/crash/traffic.h"

#include "tests/crash/fake_result.h"

#include <utility>

namespace saltus::crash {
namespace {

constexpr int largest_blob = 200000;
constexpr int recent_jobs = 12;
constexpr int one_in_so_many_is_real = 12;

void require(bool is_kept, const std::string& what) {
  if (!is_kept) throw Violation(what);
}

}  // namespace

Traffic::Traffic(const std::string& owner, unsigned seed, v1::RegistrationSpec real)
    : model(owner), generator_(seed), real_(std::move(real)) {}

void Traffic::run(const std::string& address, int actions) {
  try {
    Connection daemon(address);
    while (actions-- > 0) act(daemon);
  } catch (const DaemonGone&) {
    // What this call was to do may have been done or not: the model says so.
  }
}

KnownJob* Traffic::random_job() {
  if (model.jobs.empty()) return nullptr;
  const int count = static_cast<int>(model.jobs.size());
  // Mostly one of the last, in which something happens.
  const int back = random_below(4) > 0 ? random_below(std::min(count, recent_jobs)) : random_below(count);
  KnownJob& job = model.jobs[static_cast<std::size_t>(count - 1 - back)];
  return job.id.empty() ? nullptr : &job;
}

void Traffic::act(Connection& daemon) {
  const int choice = random_below(100);
  if (choice < 20) return upload(daemon);
  if (choice < 45) return create(daemon);
  if (choice < 52) return create_again(daemon);
  if (choice < 65) return get(daemon);
  if (choice < 75) return watch(daemon);
  if (choice < 85) return cancel(daemon);
  if (choice < 97) return remove(daemon);
  model.compare(daemon, daemon.list_all());
}

void Traffic::upload(Connection& daemon) {
  std::string bytes(static_cast<std::size_t>(random_below(largest_blob)), '\0');
  for (std::size_t i = 0; i < bytes.size(); i += 64) bytes[i] = static_cast<char>(generator_());
  bytes += model.owner() + std::to_string(generator_());
  model.uploads.push_back(daemon.upload(bytes));
}

void Traffic::create(Connection& daemon) {
  if (model.uploads.empty()) return upload(daemon);
  v1::RegistrationSpec spec = real_;
  if (random_below(one_in_so_many_is_real) > 0) {
    spec.Clear();
    const auto any = [this] {
      return model.uploads[static_cast<std::size_t>(random_below(static_cast<int>(model.uploads.size())))];
    };
    spec.mutable_fixed()->set_digest(any());
    spec.mutable_fixed()->set_format("mha");
    spec.mutable_moving()->set_digest(any());
    spec.mutable_moving()->set_format("mha");
    spec.set_output_format(fake_format);
    (*spec.mutable_settings())["regularisation"] = "0." + std::to_string(1 + random_below(1000000));
  }
  KnownJob& job = model.add(spec);
  v1::RegistrationJob said;
  const std::string reason = daemon.create(job.request, said);
  require(reason.empty(), "a job was refused: " + reason);
  model.observe(job, said);
}

void Traffic::create_again(Connection& daemon) {
  KnownJob* job = random_job();
  // The request of a deleted job is a new one.
  if (!job || job->is_deleted || job->is_delete_tried) return;
  v1::RegistrationJob said;
  const std::string reason = daemon.create(job->request, said);
  require(reason.empty(), "a repeated request was refused: " + reason);
  model.observe(*job, said);
}

void Traffic::get(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried) return;
  v1::RegistrationJob said;
  const std::string reason = daemon.get(job->id, said);
  if (job->is_deleted) return require(reason == "JOB_NOT_FOUND", "a deleted job answers '" + reason + "'");
  require(reason.empty(), "job " + job->id + " was acknowledged and answers " + reason);
  model.observe(*job, said);
}

void Traffic::watch(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried || job->is_deleted) return;
  const std::string reason =
      daemon.watch(job->id, 1 + random_below(3), [&](const v1::RegistrationJob& said) { model.observe(*job, said); });
  require(reason.empty(), "job " + job->id + " was acknowledged and its watch answers " + reason);
}

void Traffic::cancel(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried || job->is_deleted) return;
  job->is_cancel_tried = true;
  v1::RegistrationJob said;
  const std::string reason = daemon.cancel(job->id, said);
  require(reason.empty(), "job " + job->id + " was acknowledged and its cancel answers " + reason);
  model.observe(*job, said);
}

void Traffic::remove(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried || job->is_deleted) return;
  job->is_delete_tried = true;
  const std::string reason = daemon.remove(job->id);
  job->is_delete_tried = false;
  if (reason.empty()) job->is_deleted = true;
  require(reason.empty() || (reason == "JOB_RUNNING" && !job->end), "a delete answers " + reason);
}

}  // namespace saltus::crash
