#include "server/jobs/missing_inputs.h"

#include "server/jobs/job_transitions.h"

#include <algorithm>
#include <future>
#include <limits>
#include <set>

namespace saltus::server {
namespace {

std::set<std::string> missing_blobs(JobStore& rows, BlobStore& bytes) {
  std::set<std::string> missing;
  std::string last;
  while (true) {
    std::vector<BlobRow> page;
    rows.read([&](JobReader& reader) { page = reader.blobs_after(last, kBlobRowsPerPage); });
    if (page.empty()) return missing;
    last = page.back().digest;
    for (const BlobRow& row : page)
      if (!bytes.holds(row.digest, row.size)) missing.insert(row.digest);
  }
}

}  // namespace

int fail_jobs_without_inputs(JobStore& rows, BlobStore& bytes, const Clock& clock) {
  const auto missing = missing_blobs(rows, bytes);
  if (missing.empty()) return 0;
  int failed = 0;
  std::promise<void> is_durable;
  rows.write(
      [&](JobTable& table) {
        failed = 0;
        for (JobRecord& job : table.list({.state = JobState::Queued}, std::numeric_limits<std::int64_t>::max(),
                                         std::numeric_limits<int>::max())) {
          const auto lost = std::find_if(job.inputs.begin(), job.inputs.end(),
                                         [&](const std::string& digest) { return missing.contains(digest); });
          if (lost == job.inputs.end()) continue;
          job.state = *next_state(job.state, JobEvent::LoseInput);
          job.ended = clock.wall();
          job.not_before.reset();
          job.failure = {"DATA_LOSS", "the daemon's disk has lost the input " + *lost +
                                          "; upload it again and create the job again"};
          table.update(job);
          ++failed;
        }
      },
      [&](std::exception_ptr error) { error ? is_durable.set_exception(error) : is_durable.set_value(); });
  is_durable.get_future().get();
  return failed;
}

}  // namespace saltus::server
