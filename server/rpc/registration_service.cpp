#include "server/rpc/registration_service.h"

#include "core/support/errors.h"
#include "server/jobs/job_queue.h"
#include "server/jobs/refusal.h"
#include "server/rpc/convert.h"
#include "server/rpc/limits.h"
#include "server/rpc/page_token.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/validate_request.h"
#include "server/rpc/watch_stream.h"

#include <algorithm>

namespace saltus::server {
namespace {

int page_size_of(const v1::ListRegistrationJobsRequest& request) {
  return request.page_size() == 0 ? limits::kDefaultPage : std::min(request.page_size(), limits::kLargestPage);
}

}  // namespace

RegistrationServiceImpl::RegistrationServiceImpl(JobManager& jobs, const IdSource& ids,
                                                 const Authorisation& authorisation, TaskPool& pool)
    : jobs_(jobs),
      ids_(ids),
      authorisation_(authorisation),
      pool_(pool),
      watchers_("watch", limits::kWatchStreams, limits::kWatchStreamsOfOne) {}

std::optional<std::string> RegistrationServiceImpl::owner(const grpc::CallbackServerContext& context,
                                                          const char* method) const {
  return authorisation_.caller_of(context).confined_to(std::string("/saltus.v1.RegistrationService/") + method);
}

void RegistrationServiceImpl::require_own(const std::string& id, const std::optional<std::string>& owner) {
  // Who submitted a job never changes, so asking before the change itself is early enough.
  if (owner) require_owner(jobs_.get(id).job, *owner);
}

NewJob RegistrationServiceImpl::new_job(const grpc::CallbackServerContext& context,
                                        const v1::CreateRegistrationJobRequest& request) const {
  std::string content;
  NewJob job = from_message(request, content);
  const Caller caller = authorisation_.caller_of(context);
  job.submitter = caller.identity;
  job.has_quota = !caller.limited_as().empty();
  job.request_hash = ids_.fingerprint(content);
  return job;
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::CreateRegistrationJob(
    grpc::CallbackServerContext* context, const v1::CreateRegistrationJobRequest* request,
    v1::RegistrationJob* response) {
  return answer_by_reply<JobView>(
      pool_, context,
      [this, context, request](const Reply<JobView>& reply) {
        validate(*request);
        jobs_.submit(new_job(*context, *request), reply);
      },
      [response](const JobView& view) { *response = to_message(view); });
}

grpc::ServerUnaryReactor* RegistrationServiceImpl::BatchCreateRegistrationJobs(
    grpc::CallbackServerContext* context, const v1::BatchCreateRegistrationJobsRequest* request,
    v1::BatchCreateRegistrationJobsResponse* response) {
  return answer_by_reply<std::vector<JobView>>(
      pool_, context,
      [this, context, request](const Reply<std::vector<JobView>>& reply) {
        validate(*request);
        std::vector<NewJob> jobs;
        for (const auto& one : request->requests()) jobs.push_back(new_job(*context, one));
        jobs_.submit_all(jobs, reply);
      },
      [response](const std::vector<JobView>& views) {
        for (const JobView& view : views) *response->add_jobs() = to_message(view);
      });
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
    validate(*request);
    v1::ListRegistrationJobsRequest wanted = *request;
    if (const auto submitter = owner(*context, "ListRegistrationJobs")) {
      if (!wanted.submitter().empty() && wanted.submitter() != *submitter) return;
      wanted.set_submitter(*submitter);
    }
    const int page_size = page_size_of(wanted);
    const std::string conditions = ids_.fingerprint(conditions_of(wanted));
    const std::int64_t before = parse_page_token(wanted.page_token(), conditions);
    // One more than asked for tells whether there is a next page.
    auto views = jobs_.list(from_message(wanted), before, page_size + 1);
    const bool has_more = static_cast<int>(views.size()) > page_size;
    if (has_more) views.pop_back();
    std::size_t bytes = 0;
    for (const JobView& view : views) {
      v1::RegistrationJob job = to_message(view);
      bytes += job.ByteSizeLong();
      // Jobs with long specifications make a shorter page: an answer must fit into a message.
      if (response->jobs_size() > 0 && bytes > static_cast<std::size_t>(limits::kMessageBytes) / 2) {
        response->set_next_page_token(make_page_token(view.job.sequence + 1, conditions));
        return;
      }
      *response->add_jobs() = std::move(job);
    }
    if (has_more) response->set_next_page_token(make_page_token(views.back().job.sequence, conditions));
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
  return watch_job(
      jobs_, pool_, watchers_, *context, request->id(),
      [this, context] { return owner(*context, "WatchRegistrationJob"); },
      authorisation_.caller_of(*context).limited_as());
}

}  // namespace saltus::server
