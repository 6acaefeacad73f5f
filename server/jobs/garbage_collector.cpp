#include "server/jobs/garbage_collector.h"

#include <algorithm>
#include <future>

namespace saltus::server {
namespace {

// Each batch is one transaction on the writing thread, which others wait for meanwhile.
constexpr int kRowsPerBatch = 100;
constexpr std::size_t kFilesPerBatch = 8;

}  // namespace

void GarbageCollector::write(const JobStore::Operation& operation) {
  std::promise<void> is_durable;
  rows_.write(operation,
              [&](std::exception_ptr error) { error ? is_durable.set_exception(error) : is_durable.set_value(); });
  is_durable.get_future().get();
}

GarbageReport GarbageCollector::collect() {
  GarbageReport report;
  const auto uploads = bytes_.expire_uploads(retention_.uploads);
  report.uploads = uploads.count;
  report.upload_bytes = uploads.bytes;
  remove_jobs(report);
  remove_blobs(report);
  remove_orphans(report);
  return report;
}

void GarbageCollector::remove_jobs(GarbageReport& report) {
  const WallTime before = clock_.wall() - retention_.results;
  while (true) {
    std::vector<std::string> ids;
    rows_.read([&](JobReader& reader) { ids = reader.ended_before(before, kRowsPerBatch); });
    if (ids.empty()) return;
    std::vector<BlobRow> gone;
    int removed = 0;
    write([&](JobTable& table) {
      for (const std::string& id : ids) {
        const auto job = table.find(id);
        if (!job || !is_terminal(job->state)) continue;
        std::vector<std::string> digests;
        for (const Artifact& artifact : job->artifacts) digests.push_back(artifact.digest);
        if (job->checkpoint) digests.push_back(job->checkpoint->digest);
        table.erase(id);
        ++removed;
        for (const std::string& digest : digests) {
          const auto size = table.blob_size(digest);
          if (size && table.erase_blob_if_unreferenced(digest)) gone.push_back({digest, *size});
        }
      }
    });
    report.jobs += removed;
    remove_bytes(gone, report);
  }
}

void GarbageCollector::remove_blobs(GarbageReport& report) {
  const WallTime now = clock_.wall();
  write([&](JobTable& table) { table.mark_unreferenced(now); });
  while (true) {
    std::vector<BlobRow> gone;
    write([&](JobTable& table) {
      for (BlobRow& row : table.unreferenced_since(now - retention_.inputs, kRowsPerBatch))
        if (table.erase_blob_if_unreferenced(row.digest)) gone.push_back(std::move(row));
    });
    if (gone.empty()) return;
    remove_bytes(gone, report);
  }
}

void GarbageCollector::remove_bytes(const std::vector<BlobRow>& gone, GarbageReport& report) {
  for (std::size_t begin = 0; begin < gone.size(); begin += kFilesPerBatch) {
    const std::size_t end = std::min(gone.size(), begin + kFilesPerBatch);
    // On the writing thread, so that it cannot cross an upload of the same bytes.
    write([&](JobTable& table) {
      for (std::size_t i = begin; i < end; ++i)
        if (!table.blob_size(gone[i].digest)) bytes_.remove(gone[i].digest);
    });
    for (std::size_t i = begin; i < end; ++i) {
      ++report.blobs;
      report.blob_bytes += gone[i].size;
    }
  }
}

void GarbageCollector::remove_orphans(GarbageReport& report) {
  std::vector<std::string> orphans;
  const auto named = bytes_.named_before(clock_.wall() - kOrphanAge);
  rows_.read([&](JobReader& reader) {
    for (const std::string& digest : named)
      if (!reader.blob_size(digest)) orphans.push_back(digest);
  });
  for (const std::string& digest : orphans) {
    bool is_removed = false;
    write([&](JobTable& table) {
      is_removed = !table.blob_size(digest);
      if (is_removed) bytes_.remove(digest);
    });
    report.orphans += is_removed ? 1 : 0;
  }
}

}  // namespace saltus::server
