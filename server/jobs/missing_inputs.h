#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/job_store.h"

namespace saltus::server {

/// Fails the queued jobs whose inputs have a row and no bytes any more, with DATA_LOSS: they can only fail later. The
/// rows of the blobs stay, so that an upload heals them. To be called before jobs are started. Blocks. Returns how
/// many.
int fail_jobs_without_inputs(JobStore& rows, BlobStore& bytes, const Clock& clock);

}  // namespace saltus::server
