#include "tests/crash/traffic.h"

#include "tests/crash/fake_result.h"

#include <algorithm>
#include <utility>

namespace saltus::crash {
namespace {

constexpr int largest_blob = 200000;
constexpr int recent_jobs = 12;
constexpr int most_open_jobs = 15;  ///< of one client: workers are to come to all of them
constexpr int largest_batch = 4;
constexpr int one_in_so_many_is_real = 12;
constexpr int one_in_so_many_has_own_input = 3;
constexpr int one_in_so_many_collects = 10;
constexpr int inputs_to_check = 3;  ///< after each collection

void require(bool is_kept, const std::string& what) {
  if (!is_kept) throw Violation(what);
}

}  // namespace

Traffic::Traffic(const std::string& owner, unsigned seed, v1::RegistrationSpec real)
    : model(owner), generator_(seed), real_(std::move(real)) {}

void Traffic::run(const std::string& address, bool collects, const std::function<Pace()>& pace) {
  try {
    Connection daemon(address);
    for (Pace next = Pace::Busy; next != Pace::Stop; next = pace())
      if (collects && random_below(one_in_so_many_collects) == 0)
        collect_garbage(daemon);
      else if (next == Pace::Patient && random_below(3) > 0)
        watch(daemon);
      else
        act(daemon);
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
  if (choice < 10) return upload(daemon);
  if (choice < 17) return begin_upload(daemon);
  if (choice < 24) return continue_upload(daemon);
  if (choice < 46) {
    const auto open = std::count_if(model.jobs.begin(), model.jobs.end(),
                                    [](const KnownJob& job) { return !job.is_deleted && !job.end; });
    if (open >= most_open_jobs) return get(daemon);
    return choice < 42 ? create(daemon) : create_batch(daemon);
  }
  if (choice < 52) return create_again(daemon);
  if (choice < 65) return get(daemon);
  if (choice < 75) return watch(daemon);
  if (choice < 85) return cancel(daemon);
  if (choice < 96) return remove(daemon);
  if (choice < 99) return download(daemon);
  model.compare(daemon, daemon.list_all());
}

std::string Traffic::random_bytes() {
  std::string bytes(static_cast<std::size_t>(random_below(largest_blob)), '\0');
  for (std::size_t i = 0; i < bytes.size(); i += 64) bytes[i] = static_cast<char>(generator_());
  return bytes + model.owner() + std::to_string(generator_());
}

void Traffic::upload(Connection& daemon) { model.uploads.push_back(daemon.upload(random_bytes())); }

void Traffic::download(Connection& daemon) {
  if (model.uploads.empty()) return upload(daemon);
  const std::string& digest =
      model.uploads[static_cast<std::size_t>(random_below(static_cast<int>(model.uploads.size())))];
  require(digest_of(daemon.download(digest)) == digest, "blob " + digest + " has not the bytes of its digest");
}

void Traffic::collect_garbage(Connection& daemon) {
  ++Model::era.collections;
  const v1::CollectGarbageResponse said = daemon.collect_garbage();
  require(Model::era.days_ahead > 0 || said.jobs() + said.blobs() + said.uploads() == 0,
          "garbage was collected that is not a day old: " + said.ShortDebugString());
  collected.set_jobs(collected.jobs() + said.jobs());
  collected.set_blobs(collected.blobs() + said.blobs());
  collected.set_uploads(collected.uploads() + said.uploads());
  for (int i = 0; i < inputs_to_check; ++i) {
    const KnownJob* job = random_job();
    if (job && !job->own_input.empty() && !job->is_deleted && !job->is_delete_tried && !model.may_be_collected(*job))
      model.check_own_input(daemon, *job);
  }
}

void Traffic::begin_upload(Connection& daemon) {
  KnownUpload upload;
  upload.bytes = random_bytes();
  upload.id = model.owner() + "-" + std::to_string(generator_());
  upload.collections = Model::era.collections;
  model.pending.push_back(upload);
  const std::size_t end = static_cast<std::size_t>(random_below(static_cast<int>(upload.bytes.size())));
  require(!daemon.upload_piece(upload.bytes, upload.id, 0, end), "an upload that was cut is said to be done");
}

void Traffic::continue_upload(Connection& daemon) {
  if (model.pending.empty()) return begin_upload(daemon);
  const auto chosen = static_cast<std::size_t>(random_below(static_cast<int>(model.pending.size())));
  KnownUpload& upload = model.pending[chosen];
  const auto status = daemon.upload_status(upload.bytes, upload.id);
  model.observe(upload, status);
  const auto begin = static_cast<std::size_t>(status.committed_size());
  std::size_t end = upload.bytes.size();
  if (random_below(3) == 0) end = begin + static_cast<std::size_t>(random_below(static_cast<int>(end - begin) + 1));
  if (!status.complete() && !daemon.upload_piece(upload.bytes, upload.id, begin, end)) return;
  model.uploads.push_back(digest_of(upload.bytes));
  model.pending.erase(model.pending.begin() + static_cast<std::ptrdiff_t>(chosen));
}

void Traffic::finish_uploads(Connection& daemon) {
  while (!model.pending.empty()) continue_upload(daemon);
}

v1::RegistrationSpec Traffic::random_spec() {
  if (random_below(one_in_so_many_is_real) == 0) return real_;
  v1::RegistrationSpec spec;
  const auto any = [this] {
    return model.uploads[static_cast<std::size_t>(random_below(static_cast<int>(model.uploads.size())))];
  };
  spec.mutable_fixed()->set_digest(any());
  spec.mutable_fixed()->set_format("mha");
  spec.mutable_moving()->set_digest(any());
  spec.mutable_moving()->set_format("mha");
  spec.set_output_format(fake_format);
  (*spec.mutable_settings())["regularisation"] = "0." + std::to_string(1 + random_below(1000000));
  return spec;
}

void Traffic::create_batch(Connection& daemon) {
  if (model.uploads.empty()) return upload(daemon);
  const int batch = model.next_batch();
  const std::size_t first = model.jobs.size(), count = static_cast<std::size_t>(2 + random_below(largest_batch - 1));
  std::vector<v1::CreateRegistrationJobRequest> requests;
  for (std::size_t i = 0; i < count; ++i) {
    KnownJob& job = model.add(random_spec());
    job.batch = batch;
    requests.push_back(job.request);
  }
  std::vector<v1::RegistrationJob> said;
  const std::string reason = daemon.create_batch(requests, said);
  require(reason.empty(), "a batch was refused: " + reason);
  require(said.size() == count,
          "a batch of " + std::to_string(count) + " has " + std::to_string(said.size()) + " jobs");
  for (std::size_t i = 0; i < count; ++i) model.observe(model.jobs[first + i], said[i]);
}

void Traffic::create(Connection& daemon) {
  if (model.uploads.empty()) return upload(daemon);
  v1::RegistrationSpec spec = random_spec();
  std::string own_input;
  if (spec.output_format() == fake_format && random_below(one_in_so_many_has_own_input) == 0) {
    own_input = daemon.upload(random_bytes());
    spec.mutable_fixed()->set_digest(own_input);
  }
  KnownJob& job = model.add(spec);
  job.own_input = own_input;
  v1::RegistrationJob said;
  const std::string reason = daemon.create(job.request, said);
  require(reason.empty(), "a job was refused: " + reason);
  model.observe(job, said);
}

void Traffic::create_again(Connection& daemon) {
  KnownJob* job = random_job();
  // The request of a job that is gone is a new one.
  if (!job || job->is_deleted || job->is_delete_tried || model.may_be_collected(*job)) return;
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
  if (reason == "JOB_NOT_FOUND") return model.observe_absence(*job);
  require(reason.empty(), "job " + job->id + " was acknowledged and answers " + reason);
  model.observe(*job, said);
}

void Traffic::watch(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried || job->is_deleted) return;
  const std::string reason =
      daemon.watch(job->id, 1 + random_below(3), [&](const v1::RegistrationJob& said) { model.observe(*job, said); });
  if (reason == "JOB_NOT_FOUND") return model.observe_absence(*job);
  require(reason.empty(), "job " + job->id + " was acknowledged and its watch answers " + reason);
}

void Traffic::cancel(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried || job->is_deleted) return;
  job->is_cancel_tried = true;
  v1::RegistrationJob said;
  const std::string reason = daemon.cancel(job->id, said);
  if (reason == "JOB_NOT_FOUND") return model.observe_absence(*job);
  require(reason.empty(), "job " + job->id + " was acknowledged and its cancel answers " + reason);
  model.observe(*job, said);
}

void Traffic::remove(Connection& daemon) {
  KnownJob* job = random_job();
  if (!job || job->is_delete_tried || job->is_deleted) return;
  job->is_delete_tried = true;
  const std::string reason = daemon.remove(job->id);
  job->is_delete_tried = false;
  if (reason == "JOB_NOT_FOUND") return model.observe_absence(*job);
  if (reason.empty()) job->is_deleted = true;
  require(reason.empty() || (reason == "JOB_RUNNING" && !job->end), "a delete answers " + reason);
}

}  // namespace saltus::crash
