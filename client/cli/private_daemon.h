#pragma once

#include "client/cli/daemon_folder.h"

#include <filesystem>
#include <string>

#include <sys/types.h>

namespace saltus::cli {

/// A saltusd for one command: on a unix socket in a new folder that only this user can open, its data beside it. The
/// threads of its workers wait awake for each other only where there is a core for each and, with one job at a time,
/// no other such daemon was there before, since they would take the other's time.
///
/// The constructor returns when the daemon listens; the destructor ends it, waits for it and removes the folder. The
/// daemon ends by itself when this process dies, because it watches a pipe that only this process holds.
class PrivateDaemon {
 public:
  /// How much it takes on.
  struct Work {
    int jobs = 1;              ///< at the same time
    int threads = 0;           ///< that each job asks for; 0: none, so that the machine's are shared out among the jobs
    bool is_one_pair = false;  ///< there is one job and no other, so that its result may be the daemon's own files
  };
  /// Throws FileError when saltusd is not found or does not start.
  explicit PrivateDaemon(const Work& work);
  ~PrivateDaemon();
  PrivateDaemon(const PrivateDaemon&) = delete;
  PrivateDaemon& operator=(const PrivateDaemon&) = delete;

  const std::string& address() const { return address_; }
  /// Where it keeps blobs as files, see client::SharedBlobs.
  std::filesystem::path blobs() const { return data() / "blobs" / "sha256"; }

 private:
  std::filesystem::path data() const { return folder_.path() / "data"; }
  bool is_first();
  void start(const Work& work);
  void wait_until_it_listens();
  void stop();

  std::filesystem::path program_;
  DaemonFolder folder_;  ///< removed when the daemon has ended
  std::string address_;
  pid_t process_ = -1;
  int presence_ = -1;  ///< what all private daemons of a program hold a lock on, the program itself
  int stdin_write_end_ = -1;
  int stdout_read_end_ = -1;
};

/// Where saltusd is: in $SALTUS_BIN if that is set, else beside this program, else on the PATH. Throws FileError.
std::filesystem::path find_daemon();

}  // namespace saltus::cli
