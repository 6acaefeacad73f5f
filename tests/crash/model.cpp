#include "tests/crash/model.h"

#include "tests/crash/fake_result.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>

namespace saltus::crash {
namespace {

constexpr const char* owner_label = "owner";
constexpr const char* request_label = "request";
constexpr std::chrono::days results_are_kept{30};

bool is_terminal(v1::JobState state) {
  return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED;
}

/// All of a terminal job that must never change.
std::string end_of(const v1::RegistrationJob& job) {
  std::string text = v1::JobState_Name(job.state()) + " " + job.failure().reason() + " attempt " +
                     std::to_string(job.attempt()) + " ended " + job.end_time().ShortDebugString();
  for (const v1::Artifact& artifact : job.artifacts()) text += " " + artifact.name() + " " + artifact.digest();
  return text;
}

std::string label_of(const v1::RegistrationJob& job, const std::string& name) {
  const auto found = job.labels().find(name);
  return found == job.labels().end() ? "" : found->second;
}

void require_expected_artifacts(const v1::RegistrationJob& job) {
  std::map<std::string, std::string> found;
  for (const v1::Artifact& artifact : job.artifacts()) found[artifact.name()] = artifact.digest();
  if (job.spec().output_format() == fake_format) {
    for (const char* name : fake_artifacts)
      if (found[name] != digest_of(fake_result(job.spec(), name)))
        throw Violation("job " + job.id() + " has another " + name + " than its inputs give");
    return;
  }
  // Reports and transforms have times in them.
  std::erase_if(found, [](const auto& entry) { return !entry.first.ends_with(".mha"); });
  if (found.empty()) throw Violation("job " + job.id() + " has no results");
  if (Model::reference.empty()) Model::reference = found;
  if (found != Model::reference) throw Violation("job " + job.id() + " has another result than one of its kind before");
}

}  // namespace

std::map<std::string, std::string> Model::reference;
Era Model::era;

bool Era::may_have_collected_by_itself() const {
  // A minute after its start.
  return std::chrono::steady_clock::now() - daemon_start_.load() > std::chrono::seconds(50);
}

void Era::begin_daemon() {
  if (may_have_collected_by_itself()) ++collections;
  daemon_start_ = std::chrono::steady_clock::now();
}

bool Era::may_have_collected(int since) const {
  return days_ahead > 0 && (collections != since || may_have_collected_by_itself());
}

bool Era::is_over(std::chrono::system_clock::time_point end) const {
  return end + results_are_kept < std::chrono::system_clock::now() + std::chrono::days(days_ahead);
}

void Model::observe_absence(KnownJob& job) const {
  if (!job.is_deleted && !job.is_delete_tried && !may_be_collected(job))
    throw Violation("job " + job.id + " was acknowledged and is lost");
  job.is_deleted = true;
}

void Model::check_own_input(Connection& daemon, const KnownJob& job) const {
  if (digest_of(daemon.download(job.own_input)) != job.own_input)
    throw Violation("an input of job " + job.id + " has not the bytes of its digest");
}

KnownJob& Model::add(const v1::RegistrationSpec& spec) {
  KnownJob job;
  *job.request.mutable_spec() = spec;
  job.request.set_request_id(owner_ + "-" + std::to_string(++made_));
  (*job.request.mutable_labels())[owner_label] = owner_;
  (*job.request.mutable_labels())[request_label] = job.request.request_id();
  jobs.push_back(job);
  return jobs.back();
}

void Model::observe(KnownJob& job, const v1::RegistrationJob& said) {
  const std::string who = "job " + said.id() + " of request " + job.request.request_id();
  if (job.is_deleted) throw Violation(who + " is there although it was deleted");
  if (job.id.empty()) job.id = said.id();
  if (said.id() != job.id) throw Violation(who + " was job " + job.id + " before");
  if (label_of(said, request_label) != job.request.request_id()) throw Violation(who + " has another request's label");
  if (!google::protobuf::util::MessageDifferencer::Equals(said.spec(), job.request.spec()))
    throw Violation(who + " has another specification than was asked for");
  if (!is_terminal(said.state())) {
    if (job.end) throw Violation(who + " is " + v1::JobState_Name(said.state()) + " and was " + *job.end);
    return;
  }
  const std::string end = end_of(said);
  if (job.end && *job.end != end) throw Violation(who + " is " + end + " and was " + *job.end);
  if (job.end) return;
  job.end = end;
  job.end_time = std::chrono::system_clock::time_point(std::chrono::seconds(said.end_time().seconds()));
  job.artifacts.assign(said.artifacts().begin(), said.artifacts().end());
  const std::string& reason = said.failure().reason();
  if (said.state() == v1::JOB_STATE_CANCELLED && !job.is_cancel_tried)
    throw Violation(who + " was cancelled by nobody");
  if (said.state() == v1::JOB_STATE_FAILED && reason != "WORKER_CRASHED" && reason != "ATTEMPTS_EXHAUSTED")
    throw Violation(who + " failed: " + reason + ", " + said.failure().message());
  if (said.state() == v1::JOB_STATE_SUCCEEDED) require_expected_artifacts(said);
}

void Model::observe(KnownUpload& upload, const v1::QueryWriteStatusResponse& said) {
  const auto size = static_cast<std::int64_t>(upload.bytes.size());
  const std::string who = "upload " + upload.id + " of " + std::to_string(size) + " bytes";
  if (said.complete() && said.committed_size() != size)
    throw Violation(who + " is complete with " + std::to_string(said.committed_size()) + " bytes");
  if (said.committed_size() < upload.committed && !era.may_have_collected(upload.collections))
    throw Violation(who + " had " + std::to_string(upload.committed) + " bytes in safety and now has " +
                    std::to_string(said.committed_size()));
  if (said.committed_size() > size) throw Violation(who + " has more bytes than that");
  upload.committed = said.committed_size();
  upload.collections = era.collections;  // what it is told now stays while this daemon lives
}

void Model::check_batches(const std::vector<v1::RegistrationJob>& listed) const {
  std::set<std::string> made;
  for (const v1::RegistrationJob& job : listed)
    if (label_of(job, owner_label) == owner_) made.insert(label_of(job, request_label));
  std::map<int, int> asked, found;
  for (const KnownJob& job : jobs) {
    if (job.batch == 0 || !job.id.empty()) continue;
    ++asked[job.batch];
    found[job.batch] += made.contains(job.request.request_id());
  }
  for (const auto& [batch, count] : asked)
    if (found[batch] != 0 && found[batch] != count)
      throw Violation("of a batch of " + std::to_string(count) + " jobs " + std::to_string(found[batch]) +
                      " were made");
}

void Model::resolve(Connection& daemon) {
  if (std::any_of(jobs.begin(), jobs.end(), [](const KnownJob& job) { return job.batch > 0 && job.id.empty(); }))
    check_batches(daemon.list_all());
  // Asked for again one by one, so a batch that was not made is none any more.
  for (KnownJob& job : jobs)
    if (job.id.empty()) job.batch = 0;
  for (KnownJob& job : jobs) {
    if (!job.id.empty()) continue;
    v1::RegistrationJob made;
    if (const std::string reason = daemon.create(job.request, made); !reason.empty())
      throw Violation("request " + job.request.request_id() + ", repeated after a crash, was refused: " + reason);
    observe(job, made);
  }
  for (KnownUpload& upload : pending) observe(upload, daemon.upload_status(upload.bytes, upload.id));
}

void Model::compare(Connection& daemon, const std::vector<v1::RegistrationJob>& listed) {
  std::map<std::string, const v1::RegistrationJob*> by_id;
  std::set<std::string> requests;
  for (const v1::RegistrationJob& job : listed) {
    if (label_of(job, owner_label) != owner_) continue;
    by_id[job.id()] = &job;
    if (!requests.insert(label_of(job, request_label)).second)
      throw Violation("request " + label_of(job, request_label) + " has made two jobs");
  }
  std::vector<std::string> digests = uploads;
  for (KnownJob& job : jobs) {
    const auto found = by_id.find(job.id);
    if (found == by_id.end()) {
      observe_absence(job);
      continue;
    }
    job.is_delete_tried = false;  // it was not done, and nobody is left who might do it
    observe(job, *found->second);
    by_id.erase(found);
    if (may_be_collected(job)) continue;  // with its results, by another client, now
    for (const v1::Artifact& artifact : job.artifacts) digests.push_back(artifact.digest());
  }
  if (!by_id.empty()) throw Violation("job " + by_id.begin()->first + " was made for nobody");
  if (const auto missing = daemon.missing(digests); !missing.empty())
    throw Violation(std::to_string(missing.size()) + " blobs that were acknowledged are lost, among them " +
                    missing.front());
  for (KnownJob& job : jobs)
    if (!job.is_deleted && !job.is_checked && !may_be_collected(job)) check_artifacts(daemon, job);
}

void Model::check_artifacts(Connection& daemon, KnownJob& job) {
  for (const v1::Artifact& artifact : job.artifacts)
    if (digest_of(daemon.download(artifact.digest())) != artifact.digest())
      throw Violation("artefact " + artifact.name() + " of job " + job.id + " has not the bytes of its digest");
  job.is_checked = job.end.has_value();
}

}  // namespace saltus::crash
