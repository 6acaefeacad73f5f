#include "server/jobs/fsck.h"

#include "server/jobs/refusal.h"

#include <algorithm>

namespace saltus::server {
namespace {

// What a look at one blob costs at least.
constexpr std::int64_t kBlobCost = 64 << 10;

}  // namespace

bool Fsck::step(std::int64_t budget) {
  while (budget > 0 && !is_done_) {
    if (reader_ || next_blob()) {
      check(budget);
    } else {
      look_for_orphans();
      report_.uploads = bytes_.uploads_left();
      report_.set_aside = bytes_.set_aside();
      is_done_ = true;
    }
  }
  return !is_done_;
}

bool Fsck::next_blob() {
  if (next_ == page_.size()) {
    read_([&](JobReader& reader) { page_ = reader.blobs_after(last_digest_, kBlobRowsPerPage); });
    next_ = 0;
    if (page_.empty()) return false;
    last_digest_ = page_.back().digest;
  }
  row_ = page_[next_++];
  return true;
}

void Fsck::check(std::int64_t& budget) {
  // However little is left, each turn gets somewhere.
  const std::int64_t share = std::max(budget, kBlobCost);
  budget -= kBlobCost;
  try {
    if (!reader_) reader_ = bytes_.open(row_.digest, row_.size);
  } catch (const Refusal&) {
    if (is_still_missing(row_)) found(FsckFinding::Kind::Missing, row_.digest);
    ++report_.blobs;
    return;
  }
  const std::int64_t before = reader_->position();
  try {
    const bool is_at_end = reader_->advance(reader_->size(), share);
    budget -= reader_->position() - before;
    if (!is_at_end) return;
    reader_->read(1);  // an empty blob is checked by its first read
    report_.bytes += reader_->size();
  } catch (const Refusal&) {
    found(FsckFinding::Kind::Corrupt, row_.digest);
  }
  ++report_.blobs;
  reader_.reset();
}

/// The row may have been removed, or the bytes have been uploaded again, since the page was read.
bool Fsck::is_still_missing(const BlobRow& row) {
  bool is_there = false;
  read_([&](JobReader& reader) { is_there = reader.blob_size(row.digest).has_value(); });
  return is_there && !bytes_.holds(row.digest, row.size);
}

void Fsck::look_for_orphans() {
  const auto named = bytes_.named_before(clock_.wall() - kOrphanAge);
  read_([&](JobReader& reader) {
    for (const std::string& digest : named)
      if (!reader.blob_size(digest)) found(FsckFinding::Kind::Orphan, digest);
  });
}

void Fsck::found(FsckFinding::Kind kind, const std::string& digest) {
  switch (kind) {
    case FsckFinding::Kind::Corrupt:
      ++report_.corrupt;
      break;
    case FsckFinding::Kind::Missing:
      ++report_.missing;
      break;
    case FsckFinding::Kind::Orphan:
      ++report_.orphans;
      break;
  }
  findings_.push_back({kind, digest});
}

}  // namespace saltus::server
