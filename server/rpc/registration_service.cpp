#include "server/rpc/registration_service.h"

#include "core/support/errors.h"
#include "server/jobs/job_queue.h"
#include "server/jobs/refusal.h"
#include "server/rpc/convert.h"
#include "server/rpc/limits.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/validate_request.h"
#include "server/rpc/watch_stream.h"

#include <algorithm>
#include <charconv>
#include <limits>

namespace saltus::server {
namespace {

/// "<state>-<sequence>": where the next page begins, bound to the filter it was made for.
std::string make_page_token(v1::JobState state, std::int64_t before) {
  return std::to_string(static_cast<int>(state)) + "-" + std::to_string(before);
}

std::int64_t parse_page_token(const std::string& token, v1::JobState state) {
  if (token.empty()) return std::numeric_limits<std::int64_t>::max();
  const std::string prefix = std::to_string(static_cast<int>(state)) + "-";
  std::int64_t before = 0;
  if (token.starts_with(prefix)) {
    const char* end = token.data() + token.size();
    const auto parsed = std::from_chars(token.data() + prefix.size(), end, before);
    if (parsed.ec == std::errc() && parsed.ptr == end && before > 0) return before;
  }
  throw Refusal(RefusalKind::InvalidArgument, "BAD_PAGE_TOKEN",
                "page_token is not one that this list has given; begin again without page_token");
}

int page_size_of(const v1::ListRegistrationJobsRequest& request) {
  if (request.page_size() < 0)
    throw InvalidInput("page_size is " + std::to_string(request.page_size()) + "; it must be 0 (for " +
                       std::to_string(limits::kDefaultPage) + ") or more");
  return request.page_size() == 0 ? limits::kDefaultPage : std::min(request.page_size(), limits::kLargestPage);
}

}  // namespace

RegistrationServiceImpl::RegistrationServiceImpl(JobManager& jobs, const IdSource& ids,
                                                 const Authorisation& authorisation, TaskPool& pool)
    : jobs_(jobs), ids_(ids), authorisation_(authorisation), pool_(pool), watchers_("watch", limits::kWatchStreams) {}

std::optional<std::string> RegistrationServiceImpl::owner(const grpc::CallbackServerContext& context,
                                                          const char* method) const {
  return authorisation_.caller_of(context).confined_to(std::string("/saltus.v1.RegistrationService/") + method);
}

void RegistrationServiceImpl::require_own(const std::string& id, const std::optional<std::string>& owner) {
  // Who submitted a job never changes, so asking before the change itself is early enough.
  if (owner) require_owner(jobs_.get(id).job, *owner);
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::CreateRegistrationJob(
    grpc::CallbackServerContext* context, const v1::CreateRegistrationJobRequest* request,
    v1::RegistrationJob* response) {
  return answer_by_reply<JobView>(
      pool_, context,
      [this, context, request](const Reply<JobView>& reply) {
        validate(*request);
        std::string content;
        NewJob job = from_message(*request, content);
        job.submitter = authorisation_.caller_of(*context).identity;
        job.request_hash = ids_.fingerprint(content);
        jobs_.submit(job, reply);
      },
      [response](const JobView& view) { *response = to_message(view); });
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::GetRegistrationJob(grpc::CallbackServerContext* context,
                                                                      const v1::GetRegistrationJobRequest* request,
                                                                      v1::RegistrationJob* response) {
  return answer_from_pool(pool_, context, [this, context, request, response] {
    validate_job_id(request->id());
    const JobView view = jobs_.get(request->id());
    if (const auto submitter = owner(*context, "GetRegistrationJob")) require_owner(view.job, *submitter);
    *response = to_message(view);
  });
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::ListRegistrationJobs(grpc::CallbackServerContext* context,
                                                                        const v1::ListRegistrationJobsRequest* request,
                                                                        v1::ListRegistrationJobsResponse* response) {
  return answer_from_pool(pool_, context, [this, context, request, response] {
    const auto submitter = owner(*context, "ListRegistrationJobs");
    const int page_size = page_size_of(*request);
    const auto state = from_message(request->state());
    if (!state && request->state() != v1::JOB_STATE_UNSPECIFIED)
      throw InvalidInput("state is " + std::to_string(static_cast<int>(request->state())) +
                         "; it must be a JobState, or unspecified for all");
    const std::int64_t before = parse_page_token(request->page_token(), request->state());
    // One more than asked for tells whether there is a next page.
    auto views = jobs_.list(state, before, page_size + 1);
    const bool has_more = static_cast<int>(views.size()) > page_size;
    if (has_more) views.pop_back();
    std::size_t bytes = 0;
    for (const JobView& view : views) {
      if (submitter && view.job.submitter != *submitter) continue;
      v1::RegistrationJob job = to_message(view);
      bytes += job.ByteSizeLong();
      // Jobs with long specifications make a shorter page: an answer must fit into a message.
      if (response->jobs_size() > 0 && bytes > static_cast<std::size_t>(limits::kMessageBytes) / 2) {
        response->set_next_page_token(make_page_token(request->state(), view.job.sequence + 1));
        return;
      }
      *response->add_jobs() = std::move(job);
    }
    if (has_more) response->set_next_page_token(make_page_token(request->state(), views.back().job.sequence));
  });
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::CancelRegistrationJob(
    grpc::CallbackServerContext* context, const v1::CancelRegistrationJobRequest* request,
    v1::RegistrationJob* response) {
  return answer_by_reply<JobView>(
      pool_, context,
      [this, context, request](const Reply<JobView>& reply) {
        validate_job_id(request->id());
        require_own(request->id(), owner(*context, "CancelRegistrationJob"));
        jobs_.cancel(request->id(), reply);
      },
      [response](const JobView& view) { *response = to_message(view); });
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::DeleteRegistrationJob(
    grpc::CallbackServerContext* context, const v1::DeleteRegistrationJobRequest* request,
    v1::DeleteRegistrationJobResponse*) {
  return answer_by_reply<std::string>(
      pool_, context,
      [this, context, request](const Reply<std::string>& reply) {
        validate_job_id(request->id());
        require_own(request->id(), owner(*context, "DeleteRegistrationJob"));
        jobs_.remove(request->id(), reply);
      },
      [](const std::string&) {});
}

grpc::ServerWriteReactor<v1::WatchRegistrationJobResponse>* RegistrationServiceImpl::WatchRegistrationJob(
    grpc::CallbackServerContext* context, const v1::WatchRegistrationJobRequest* request) {
  return watch_job(jobs_, pool_, watchers_, *context, request->id(),
                   [this, context] { return owner(*context, "WatchRegistrationJob"); });
}

}  // namespace saltus::server
