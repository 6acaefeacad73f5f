#pragma once

#include "saltus/v1/registration.pb.h"
#include "saltus/v1/worker.pb.h"

#include <string>
#include <vector>

/// What can be known about a request without decoding an image or asking the store. Each throws InvalidInput, or
/// Refusal OutOfRange where it says so, with one sentence that names the field, the value and the way out.
namespace saltus::server {

void validate(const v1::CreateRegistrationJobRequest& request);
void validate(const v1::BatchCreateRegistrationJobsRequest& request);
void validate(const v1::ListRegistrationJobsRequest& request);
void validate(const v1::FindMissingBlobsRequest& request);
void validate(const v1::ReadBlobRequest& request);
void validate(const v1::AcquireLeaseRequest& request);
void validate(const v1::TakeJobRequest& request);
void validate(const v1::PutCheckpointRequest& request);
void validate(const v1::CompleteJobRequest& request);
/// The first message of an upload.
void validate_upload(const v1::WriteBlobRequest& first);
void validate(const v1::QueryWriteStatusRequest& request);
void validate_job_id(const std::string& id);

/// What ServerInfo lists and validate accepts.
const std::vector<std::string>& image_formats();

}  // namespace saltus::server
