#include "server/jobs/blob_catalog.h"

#include "server/jobs/refusal.h"

#include <future>
#include <map>

namespace saltus::server {

std::vector<std::string> BlobCatalog::missing(const std::vector<std::string>& digests) {
  std::map<std::string, std::int64_t> sizes;
  std::vector<std::string> marked;
  rows_.read([&](JobReader& reader) {
    for (const std::string& digest : digests) {
      const auto size = reader.blob_size(digest);
      if (!size) continue;
      sizes[digest] = *size;
      if (reader.is_marked_unreferenced(digest)) marked.push_back(digest);
    }
  });
  for (const std::string& digest : renew(marked)) sizes.erase(digest);
  // A row whose bytes were damaged from outside counts as missing, so that a new upload heals it.
  std::vector<std::string> result;
  for (const std::string& digest : digests) {
    const auto found = sizes.find(digest);
    if (found == sizes.end() || !bytes_.holds(digest, found->second)) result.push_back(digest);
  }
  return result;
}

/// Who is told that a blob is here means to use it: its time begins anew, before the answer, so that neither a
/// collection of garbage nor a crash can come between. Returns those that a collection has removed meanwhile.
std::vector<std::string> BlobCatalog::renew(const std::vector<std::string>& marked) {
  if (marked.empty()) return {};
  std::vector<std::string> gone;
  std::promise<void> is_durable;
  rows_.write(
      [&](JobTable& table) {
        gone.clear();
        for (const std::string& digest : marked) {
          if (!table.blob_size(digest)) gone.push_back(digest);
          table.unmark_unreferenced(digest);
        }
      },
      [&](std::exception_ptr error) { error ? is_durable.set_exception(error) : is_durable.set_value(); });
  try {
    is_durable.get_future().get();
  } catch (const Refusal& refusal) {
    // A daemon that only reads removes nothing either.
    if (refusal.kind() != RefusalKind::Unavailable) throw;
  }
  return gone;
}

bool BlobCatalog::has(const std::string& digest, std::int64_t size) {
  std::optional<std::int64_t> known;
  bool is_marked = false;
  rows_.read([&](JobReader& reader) {
    known = reader.blob_size(digest);
    is_marked = known && reader.is_marked_unreferenced(digest);
  });
  if (known != size || (is_marked && !renew({digest}).empty())) return false;
  return bytes_.holds(digest, size);
}

std::unique_ptr<BlobUpload> BlobCatalog::begin(const UploadPlan& plan) {
  UploadQuota::Claim claim;
  if (plan.quota > 0)
    claim = quota_.claim(plan.owner, plan.size, plan.quota, [&] {
      // What is parked meanwhile still has its claim, and what is stored meanwhile too.
      std::int64_t bytes = bytes_.waiting_beside(plan);
      rows_.read([&](JobReader& reader) { bytes += reader.blob_bytes_of(plan.owner); });
      return bytes;
    });
  auto upload = bytes_.begin(plan);
  upload->claim = std::move(claim);
  return upload;
}

std::int64_t BlobCatalog::committed(const UploadPlan& plan) { return bytes_.committed(plan); }

void BlobCatalog::commit(std::shared_ptr<BlobUpload> upload, JobStore::Done done) {
  // The file gets its name on the writing thread, so that it cannot cross a removal of the same digest.
  rows_.write(
      [this, upload](JobTable& table) {
        bytes_.publish(*upload);
        table.insert_blob(upload->digest(), upload->size(), clock_.wall(), upload->owner());
      },
      std::move(done));
}

std::unique_ptr<BlobReader> BlobCatalog::open(const std::string& digest) {
  std::optional<std::int64_t> size;
  rows_.read([&](JobReader& reader) { size = reader.blob_size(digest); });
  if (!size)
    throw Refusal(RefusalKind::NotFound, "BLOB_NOT_FOUND",
                  "there is no blob " + digest + " on the server; upload it first");
  return bytes_.open(digest, *size);
}

void BlobCatalog::drop_bytes(std::vector<std::string> digests) {
  if (digests.empty()) return;
  // In an operation of its own: a blob that was uploaded again meanwhile has its row again and stays. What a crash
  // leaves over has no row and is removed at the next start.
  rows_.write(
      [this, digests = std::move(digests)](JobTable& table) {
        for (const std::string& digest : digests)
          if (!table.blob_size(digest)) bytes_.remove(digest);
      },
      [](std::exception_ptr) {});
}

}  // namespace saltus::server
