#include "server/launch/batch_listing.h"

#include <sys/wait.h>

#include <charconv>
#include <set>
#include <sstream>

namespace saltus::server {
namespace {

// A shell tells the death of what it ran by such an exit code; exec leaves no shell, but a site may put one around.
constexpr int kShellSignal = 128;

std::string trimmed(const std::string& text) {
  const auto end = text.find_last_not_of(' ');
  return end == std::string::npos ? "" : text.substr(0, end + 1);
}

std::string without(const std::string& text, const char* nothing) { return text == nothing ? "" : text; }

WorkerExit exit_of(int status) {
  if (WIFSIGNALED(status)) return {WorkerExit::Kind::Signalled, WTERMSIG(status)};
  const int code = WEXITSTATUS(status);
  if (code > kShellSignal) return {WorkerExit::Kind::Signalled, code - kShellSignal};
  return {WorkerExit::Kind::Exited, code};
}

}  // namespace

Command listing() {
  // One width for each field: a name that was cut off would be another one.
  return {{"squeue", "--noheader", "--me", "--states=all", "--array", "-O",
           "JobArrayID:64|,Name:160|,State:32|,exit_code:16|,BatchHost:128|,Reason:128"},
          ""};
}

std::optional<std::vector<BatchRow>> parse_listing(const std::string& text) {
  std::vector<BatchRow> rows;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> fields;
    std::istringstream parts(line);
    for (std::string part; std::getline(parts, part, '|');) fields.push_back(trimmed(part));
    // A name of somebody else's job may hold the mark between the fields; ours do not.
    if (fields.size() > 6) continue;
    if (fields.size() < 6 || fields[0].empty() || fields[2].empty()) return std::nullopt;
    BatchRow row{fields[0], fields[1], fields[2], 0, without(fields[4], "n/a"), without(fields[5], "None")};
    const std::string& code = fields[3];
    const auto parsed = std::from_chars(code.data(), code.data() + code.size(), row.wait_status);
    if (parsed.ec != std::errc() || parsed.ptr != code.data() + code.size()) return std::nullopt;
    rows.push_back(std::move(row));
  }
  return rows;
}

bool is_pending(const BatchRow& row) {
  return row.state == "PENDING" || row.state == "CONFIGURING" || row.state == "REQUEUED" ||
         row.state == "REQUEUE_HOLD" || row.state == "REQUEUE_FED" || row.state == "SPECIAL_EXIT" ||
         row.state == "STAGE_OUT" || row.state == "RESV_DEL_HOLD";
}

bool was_never_possible(const BatchRow& row) { return row.state == "FAILED" && row.reason == "BadConstraints"; }

bool can_never_start(const BatchRow& row) {
  // What limits one job, whoever else waits or runs. What limits an account, a user or a node passes.
  static const std::set<std::string> kForGood = {"AssocMaxCpuMinutesPerJobLimit",
                                                 "AssocMaxCpuPerJobLimit",
                                                 "AssocMaxMemPerJob",
                                                 "AssocMaxWallDurationPerJobLimit",
                                                 "BadConstraints",
                                                 "DependencyNeverSatisfied",
                                                 "MaxMemPerLimit",
                                                 "PartitionConfig",
                                                 "PartitionNodeLimit",
                                                 "PartitionTimeLimit",
                                                 "QOSMaxCpuMinutesPerJobLimit",
                                                 "QOSMaxCpuPerJobLimit",
                                                 "QOSMaxMemoryPerJob",
                                                 "QOSMaxWallDurationPerJobLimit"};
  return is_pending(row) && kForGood.contains(row.reason);
}

std::optional<WorkerExit> end_of(const BatchRow& row) {
  if (row.state == "COMPLETED") return WorkerExit{WorkerExit::Kind::Exited, 0};
  if (was_never_possible(row)) return WorkerExit{WorkerExit::Kind::NeverStarts, 0, row.reason};
  if (row.state == "FAILED") return exit_of(row.wait_status);
  if (row.state == "OUT_OF_MEMORY") return WorkerExit{WorkerExit::Kind::Exited, kOutOfMemoryExit};
  if (row.state == "TIMEOUT" || row.state == "DEADLINE") return WorkerExit{WorkerExit::Kind::TimeLimit};
  if (row.state == "PREEMPTED") return WorkerExit{WorkerExit::Kind::Preempted};
  if (row.state == "NODE_FAIL" || row.state == "BOOT_FAIL") return WorkerExit{WorkerExit::Kind::NodeFailed};
  if (row.state == "CANCELLED" || row.state == "REVOKED") return WorkerExit{WorkerExit::Kind::Withdrawn};
  return std::nullopt;
}

}  // namespace saltus::server
