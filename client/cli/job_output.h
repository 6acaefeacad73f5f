#pragma once

#include "saltus/v1/registration.pb.h"

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <vector>

namespace saltus::cli {

/// "RUNNING" for JOB_STATE_RUNNING.
std::string state_name(v1::JobState state);
/// The inverse, in any case. Throws InvalidInput that lists the states.
v1::JobState parse_state(const std::string& text);
/// "optimising" for JOB_STAGE_OPTIMISING; "starting" before the first report.
std::string stage_name(v1::JobStage stage);

/// The job for programs. Field names are those of the protocol; states and stages without prefix, times as RFC 3339 in
/// UTC; what has no value yet (failure, end_time, ...) is left out.
nlohmann::json job_json(const v1::RegistrationJob& job);

/// The job for people: one "name: value" a line.
std::string job_text(const v1::RegistrationJob& job);

/// Header and one line for each job.
std::string job_table(const std::vector<v1::RegistrationJob>& jobs);

/// What a job that did not succeed is said to have ended with: "job ID failed (REASON): message".
std::string failure_line(const v1::RegistrationJob& job);

}  // namespace saltus::cli
