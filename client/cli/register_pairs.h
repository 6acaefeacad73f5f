#pragma once

#include "client/cli/connection.h"
#include "client/cli/job_options.h"

#include <filesystem>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace saltus::cli {

/// One line of a list: its files, and the name of its folder.
struct Pair {
  std::string name;
  JobOptions job;  ///< the common options with this pair's files
};

/// Adds --jobs.
CLI::Option* add_jobs_option(CLI::App& app, int& jobs);

/// Reads a list of pairs: CSV with a header that has `fixed` and `moving` and may have `name`, `fixed_mask`,
/// `moving_mask`, `fixed_points` and `moving_points`, in any order; quotes as in RFC 4180; paths from the list's
/// folder; an empty field is none; a pair without a name is called pair_1, pair_2, ... by its row. Throws InvalidInput
/// that names the line for what cannot be meant: unknown or missing columns, a file that is not there, a name twice or
/// one that is no folder's name, and files given by `common` and by the list.
std::vector<Pair> read_pairs(const std::filesystem::path& file, const JobOptions& common);

/// Whether a list tells at its end what was done, or leaves that to its caller.
enum class PairsOutput { Summary, Silent };

struct PairsRequest {
  JobOptions job;
  ServerChoice server;
  std::string pairs;
  std::filesystem::path out;
  bool as_json = false;
  int jobs = 0;  ///< at the same time; 0: as many as there are cores, on a server jobs_on_server
  PairsOutput output = PairsOutput::Summary;
};

/// Registers them, `jobs` at a time, each into a folder of its name below `out`. A pair that is done, from the same
/// files with the same options, is not done again; one that was done otherwise is refused before anything is begun. A
/// pair that fails does not stop the others. Writes `out`/summary.csv, a line a pair, after each. The exit code: Done
/// when all pairs are done, Cancelled when interrupted, else JobFailed.
int register_pairs(const PairsRequest& request);

/// The same with pairs that are made already; `request.pairs` is not read.
int register_pairs(const std::vector<Pair>& pairs, const PairsRequest& request);

/// How many pairs run at the same time on a server with so many slots, unless another number is asked for: one for each
/// slot, as far as one client may have that many streams. 0 slots: Slurm decides how many run.
int jobs_on_server(int worker_slots);

/// A pair that is being registered.
struct RunningPair {
  std::string name;
  double fraction = 0;       ///< of its work that is done; never falls, though a stage may begin at 0
  double seconds_left = -1;  ///< negative while unknown
};

/// How far a list is.
struct ListProgress {
  std::size_t count = 0;       ///< of all pairs
  std::size_t done = 0;        ///< or failed
  double seconds_a_pair = -1;  ///< mean of those done by now; negative while unknown
  std::size_t jobs = 1;        ///< at the same time
  std::vector<RunningPair> running;
  std::size_t failed = 0;  ///< of those that are done
};

/// "pair 3 of 12, 45 % of all, 7:30 min left in all" while one runs, and else "3 of 12 pairs done, 45 % of all, 7:30
/// min left in all; a 40 %, b 10 %"; "3 of 12 pairs done, 1 failed, ..." when one did.
std::string list_progress(const ListProgress& progress);

}  // namespace saltus::cli
