#pragma once

#include "server/jobs/job_manager.h"

#include "saltus/v1/registration.pb.h"
#include "saltus/v1/worker.pb.h"

#include <optional>
#include <string>

/// The only pair of files that knows both the wire's types and the queue's.
namespace saltus::server {

v1::RegistrationJob to_message(const JobView& view);
v1::JobState to_message(JobState state);
/// Nothing for unspecified and for numbers that this version does not know.
std::optional<JobState> from_message(v1::JobState state);

v1::JobProgress to_message(const JobProgress& progress);
JobProgress from_message(const v1::JobProgress& progress);

/// Without its request_hash, which takes a fingerprint of `content`: the same bytes for the same request.
NewJob from_message(const v1::CreateRegistrationJobRequest& request, std::string& content);
JobFilter from_message(const v1::ListRegistrationJobsRequest& request);
/// The same bytes for the same conditions.
std::string conditions_of(const v1::ListRegistrationJobsRequest& request);
Outcome from_message(const v1::CompleteJobRequest& request);
Checkpoint from_message(const v1::Checkpoint& message);
v1::AcquireLeaseResponse to_message(const LeaseGrant& grant);

}  // namespace saltus::server
