#include "server/offline_fsck.h"

#include "server/jobs/fsck.h"
#include "server/store/blob_directory.h"
#include "server/store/data_directory.h"
#include "server/store/sqlite_job_store.h"
#include "server/store/sqlite_job_table.h"

#include <limits>

namespace saltus::server {
namespace {

const char* describe(FsckFinding::Kind kind) {
  switch (kind) {
    case FsckFinding::Kind::Corrupt:
      return "damaged, set aside in corrupt/";
    case FsckFinding::Kind::Missing:
      return "missing";
    case FsckFinding::Kind::Orphan:
      return "without a row, harmless";
  }
  return "";
}

}  // namespace

bool check_data_folder(const std::filesystem::path& data, std::ostream& out) {
  if (!std::filesystem::exists(data / "saltusd.db"))
    throw std::runtime_error("--data is " + data.string() + ", which is no folder of saltusd: it has no saltusd.db");
  const DataDirectory directory(data);
  require_sound_database(directory.database());
  Database database(directory.database(), Database::Access::ReadOnly);
  const SystemClock clock;
  StorageState state;
  BlobDirectory bytes({directory.blobs(), directory.uploads(), directory.corrupt()}, state, clock);
  Fsck fsck(
      [&](const std::function<void(JobReader&)>& operation) {
        SqliteJobTable table(database);
        operation(table);
      },
      bytes, clock);
  bool goes_on = true;
  while (goes_on) {
    goes_on = fsck.step(std::numeric_limits<std::int32_t>::max());
    for (const FsckFinding& finding : fsck.take_findings())
      out << finding.digest << ": " << describe(finding.kind) << '\n';
  }
  const FsckReport& report = fsck.report();
  out << report.blobs << " blobs, " << report.bytes << " bytes checked: " << report.corrupt << " damaged, "
      << report.missing << " missing, " << report.orphans << " files without a row, " << report.uploads
      << " uploads that can be continued, " << report.set_aside << " damaged files set aside" << std::endl;
  return report.is_healthy();
}

}  // namespace saltus::server
