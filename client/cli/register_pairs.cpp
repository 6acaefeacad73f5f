#include "client/cli/register_pairs.h"

#include "client/cli/command.h"
#include "client/cli/input_check.h"
#include "client/cli/job_output.h"
#include "client/cli/progress_display.h"
#include "client/cli/registrar.h"
#include "client/cli/report_summary.h"
#include "client/cli/result_files.h"
#include "client/cli/run_job.h"
#include "client/lib/checksum.h"
#include "client/lib/client_error.h"
#include "core/image_io/temporary_file.h"
#include "core/support/available_cores.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <fstream>
#include <iostream>
#include <mutex>
#include <optional>
#include <set>
#include <sstream>
#include <thread>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

/// One row of CSV after the other; a quoted field may hold commas, quotes (doubled) and ends of lines.
class CsvReader {
 public:
  explicit CsvReader(const fs::path& file) : name_("--pairs " + file.string()) {
    std::ifstream in(file, std::ios::binary);
    std::ostringstream all;
    if (in) all << in.rdbuf();
    if (!in) throw InvalidInput(name_ + " cannot be read");
    text_ = all.str();
    if (text_.starts_with("\xEF\xBB\xBF")) at_ = 3;
  }

  /// The next row that is not empty; nothing at the end.
  std::optional<std::vector<std::string>> next() {
    while (at_ < text_.size()) {
      line_ = next_line_;
      std::vector<std::string> row = read_row();
      if (row.size() > 1 || !row.front().empty()) return row;
    }
    return std::nullopt;
  }

  [[noreturn]] void refuse(const std::string& reason) const {
    throw InvalidInput(name_ + ": line " + std::to_string(line_) + " " + reason);
  }

 private:
  std::vector<std::string> read_row() {
    std::vector<std::string> row(1);
    bool is_quoted = false;
    while (at_ < text_.size()) {
      const char letter = text_[at_++];
      next_line_ += letter == '\n';
      if (is_quoted) {
        if (letter != '"')
          row.back() += letter;
        else if (at_ < text_.size() && text_[at_] == '"')
          row.back() += text_[at_++];
        else
          is_quoted = false;
      } else if (letter == '"') {
        is_quoted = true;
      } else if (letter == ',') {
        row.emplace_back();
      } else if (letter == '\n') {
        break;
      } else if (letter != '\r') {
        row.back() += letter;
      }
    }
    if (is_quoted) refuse("opens a quote that nothing closes");
    return row;
  }

  std::string name_, text_;
  std::size_t at_ = 0;
  int line_ = 1, next_line_ = 1;
};

struct Column {
  const char* name;
  std::string JobOptions::*file;  ///< null: the pair's name
};
constexpr Column columns[] = {{"name", nullptr},
                              {"fixed", &JobOptions::fixed},
                              {"moving", &JobOptions::moving},
                              {"fixed_mask", &JobOptions::fixed_mask},
                              {"moving_mask", &JobOptions::moving_mask},
                              {"fixed_points", &JobOptions::fixed_points},
                              {"moving_points", &JobOptions::moving_points}};

std::vector<const Column*> read_header(CsvReader& reader, const JobOptions& common) {
  const auto header = reader.next();
  if (!header) reader.refuse("is the end; there must be a header with the columns fixed and moving");
  std::vector<const Column*> found;
  for (const std::string& name : *header) {
    const auto* column =
        std::find_if(std::begin(columns), std::end(columns), [&name](const Column& one) { return name == one.name; });
    if (column == std::end(columns))
      reader.refuse("has the column '" + name +
                    "'; there are name, fixed, moving, fixed_mask, moving_mask, fixed_points and moving_points");
    if (std::find(found.begin(), found.end(), column) != found.end())
      reader.refuse("has the column " + name + " twice");
    if (column->file && !(common.*column->file).empty())
      reader.refuse("has the column " + name + ", which an option gives too; leave one of them out");
    found.push_back(column);
  }
  for (const char* needed : {"fixed", "moving"})
    if (std::none_of(found.begin(), found.end(), [&](const Column* one) { return one->name == std::string(needed); }))
      reader.refuse(std::string("has no column ") + needed);
  return found;
}

/// The options and inputs that decide about a result, as a hash. Threads do not.
std::string fingerprint(const JobOptions& job) {
  nlohmann::json all{job.model,
                     job.similarity,
                     job.preset,
                     job.affine,
                     job.intensity_window,
                     job.crop,
                     job.format,
                     job.settings,
                     job.points_format.space,
                     job.points_format.unit};
  for (const Column& column : columns) {
    if (!column.file) continue;
    const std::string& file = job.*column.file;
    all.push_back(file.empty() ? "" : client::digest_of_file(file).digest);
  }
  client::Sha256 hash;
  hash.add(all.dump());
  return hash.digest();
}

bool is_done(const Pair& pair, const fs::path& folder) {
  const fs::path file = folder / done_file;
  if (!fs::exists(file)) return false;
  const nlohmann::json done = read_report(file);
  if (done.value("request", "") == fingerprint(pair.job)) return true;
  throw InvalidInput(folder.string() +
                     " holds the result of other files or options; name another --out, or remove that folder to have "
                     "the pair done again");
}

void write_done(const Pair& pair, const fs::path& folder) {
  const fs::path file = folder / done_file;
  TemporaryFile temporary(file);
  std::ofstream out(temporary.path());
  out << nlohmann::json{{"request", fingerprint(pair.job)}}.dump() << '\n';
  out.close();
  if (!out) throw FileError(file.string() + " cannot be written");
  temporary.take_place();
}

struct Outcome {
  const Pair* pair;
  std::string state;  ///< "done", "failed" or "" while nothing is known
  std::string why;
};

std::string csv_quoted(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string safe = "\"";
  for (char letter : text) safe += letter == '"' ? std::string("\"\"") : std::string(1, letter);
  return safe + '"';
}

std::string number_at(const nlohmann::json& report, const char* path) {
  const nlohmann::json::json_pointer pointer(path);
  return report.contains(pointer) && report.at(pointer).is_number() ? report.at(pointer).dump() : "";
}

void write_summary(const std::vector<Outcome>& outcomes, const fs::path& folder) {
  std::ostringstream text;
  text << "name,state,landmarks_before_mm,landmarks_after_mm,similarity_before,similarity_after,jacobian_min,"
          "share_folded,cpu_seconds,reason\n";
  for (const Outcome& outcome : outcomes) {
    if (outcome.state.empty()) continue;
    const nlohmann::json report =
        outcome.state == "done" ? read_report(folder / outcome.pair->name / "report.json") : nlohmann::json();
    text << csv_quoted(outcome.pair->name) << ',' << outcome.state;
    for (const char* path :
         {"/landmark_error_mm/before/mean", "/landmark_error_mm/after/mean", "/similarity_value/before",
          "/similarity_value/after", "/jacobian/min", "/jacobian/share_not_positive", "/seconds/cpu"})
      text << ',' << number_at(report, path);
    text << ',' << csv_quoted(outcome.why) << '\n';
  }
  const fs::path file = folder / "summary.csv";
  TemporaryFile temporary(file);
  std::ofstream out(temporary.path(), std::ios::binary);
  out << text.str();
  out.close();
  if (!out) throw FileError(file.string() + " cannot be written");
  temporary.take_place();
}

}  // namespace

CLI::Option* add_jobs_option(CLI::App& app, int& jobs) {
  return app
      .add_option("--jobs", jobs,
                  "Pairs at the same time; 0: as many as there are cores, on a server as many as it has slots, at\n"
                  "most 8. The private daemon shares the cores out among them")
      ->type_name("N")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
}

std::vector<Pair> read_pairs(const fs::path& file, const JobOptions& common) {
  CsvReader reader(file);
  const std::vector<const Column*> header = read_header(reader, common);
  std::vector<Pair> pairs;
  std::set<std::string> names;
  while (const auto row = reader.next()) {
    if (row->size() != header.size())
      reader.refuse("has " + std::to_string(row->size()) + " fields; the header has " + std::to_string(header.size()));
    Pair pair{"pair_" + std::to_string(pairs.size() + 1), common};
    for (std::size_t i = 0; i < header.size(); ++i) {
      const std::string& field = (*row)[i];
      if (field.empty()) continue;
      if (!header[i]->file) {
        pair.name = field;
        continue;
      }
      const fs::path path = file.parent_path() / field;
      if (!fs::exists(path)) reader.refuse("names " + path.string() + ", which is not there");
      pair.job.*header[i]->file = path.string();
    }
    if (pair.job.fixed.empty()) reader.refuse("names no fixed image");
    if (pair.job.moving.empty()) reader.refuse("names no moving image");
    const fs::path folder = pair.name;
    if (folder != folder.filename() || pair.name == "." || pair.name == "..")
      reader.refuse("has the name '" + pair.name + "', which cannot be a folder's");
    if (!names.insert(pair.name).second) reader.refuse("has the name " + pair.name + ", as one before it");
    pairs.push_back(std::move(pair));
  }
  if (pairs.empty()) reader.refuse("is the end; there is no pair below the header");
  return pairs;
}

std::string list_progress(const ListProgress& progress) {
  double running = 0, longest_left = 0;
  for (const RunningPair& one : progress.running) {
    const double fraction = std::clamp(one.fraction, 0.0, 1.0);
    running += fraction;
    const double guessed = progress.seconds_a_pair * (1 - fraction);
    longest_left = std::max(longest_left, one.seconds_left >= 0 ? one.seconds_left : guessed);
  }
  const auto count = static_cast<double>(progress.count), done = static_cast<double>(progress.done);
  std::ostringstream text;
  if (progress.jobs == 1)
    text << "pair " << progress.done + progress.running.size() << " of " << progress.count;
  else
    text << progress.done - progress.failed << " of " << progress.count << " pairs done";
  if (progress.jobs > 1 && progress.failed > 0) text << ", " << progress.failed << " failed";
  text << ", " << std::lround(100 * (done + running) / count) << " % of all";
  if (progress.seconds_a_pair >= 0) {
    // Those that wait go side by side too.
    const double waiting = count - done - static_cast<double>(progress.running.size());
    const double left = longest_left + progress.seconds_a_pair * waiting / static_cast<double>(progress.jobs);
    text << ", " << format_seconds(left) << " left in all";
  }
  if (progress.jobs > 1)
    for (std::size_t i = 0; i < progress.running.size(); ++i)
      text << (i == 0 ? "; " : ", ") << progress.running[i].name << ' '
           << std::lround(100 * std::clamp(progress.running[i].fraction, 0.0, 1.0)) << " %";
  return text.str();
}

int jobs_on_server(int worker_slots) {
  // What a server takes of one certificate at the same time, in uploads and in downloads; it refuses more, and a list
  // ends with what is refused for longer than the client tries again (server/rpc/limits.h).
  constexpr int most_at_once = 8;
  return worker_slots > 0 ? std::min(worker_slots, most_at_once) : most_at_once;
}

namespace {

int threads_of_a_job(const std::vector<Pair>& pairs) {
  int most = 0;
  for (const Pair& pair : pairs) most = std::max(most, pair.job.threads);
  return most;
}

/// Of those that are left as many as get all of them done first: with one thread each, two cores do more than with both
/// for one after the other (deploy/README.md, "Many pairs on one machine").
int jobs_at_once(const std::vector<Pair>& pairs, const PairsRequest& request, std::size_t left) {
  int most = request.jobs;
  if (most == 0 && request.server.address.empty()) {
    most = available_cores() / std::max(1, threads_of_a_job(pairs));
  } else if (most == 0) {
    client::RegistrationClient server(call_settings(request.server));
    most = jobs_on_server(server.server_info().worker_slots());
  }
  return static_cast<int>(std::min(left, static_cast<std::size_t>(std::max(1, most))));
}

/// Works through a list: takes the next pair, runs it, enters how it ended, until none is left or one cannot go on.
class PairList {
 public:
  PairList(const std::vector<Pair>& pairs, const PairsRequest& request, int jobs, std::vector<Outcome>& outcomes)
      : pairs_(pairs),
        request_(request),
        jobs_(jobs),
        outcomes_(outcomes),
        registrar_(request.server, {jobs, threads_of_a_job(pairs)}),
        display_(std::cerr, display_style_of_stderr()) {
    progress_.count = pairs.size();
    progress_.jobs = static_cast<std::size_t>(jobs);
    for (const Outcome& outcome : outcomes) progress_.done += outcome.state == "done";
  }

  /// Cancelled when a job was, else Done. Rethrows what ended a pair otherwise than by its job's failure.
  ExitCode run() {
    {
      std::vector<std::jthread> threads;
      for (int i = 0; i < jobs_; ++i) threads.emplace_back([this] { work(); });
    }
    display_.finish();
    if (problem_ && !registrar_.is_interrupted()) std::rethrow_exception(problem_);
    if (problem_)
      std::cerr << "saltus: interrupted; the same command goes on with the pairs that are left" << std::endl;
    return problem_ || is_cancelled_ ? Cancelled : Done;
  }

 private:
  std::optional<std::size_t> take() {
    std::lock_guard lock(mutex_);
    while (next_ < pairs_.size() && outcomes_[next_].state == "done") ++next_;
    if (problem_ || is_cancelled_ || next_ == pairs_.size()) return std::nullopt;
    progress_.running.push_back({pairs_[next_].name});
    return next_++;
  }

  void work() {
    while (const auto i = take()) {
      try {
        run_pair(*i);
      } catch (...) {
        std::lock_guard lock(mutex_);
        if (!problem_) problem_ = std::current_exception();
        return;
      }
    }
  }

  void run_pair(std::size_t i) {
    const Pair& pair = pairs_[i];
    const fs::path out = request_.out / pair.name;
    const ResultFolder folder(out);
    const auto begin = std::chrono::steady_clock::now();
    const v1::RegistrationJob job =
        registrar_.run(pair.job, make_spec(pair.job), out, [&](const v1::RegistrationJob& now) { show(pair, now); });
    if (job.state() == v1::JOB_STATE_SUCCEEDED) write_done(pair, out);
    std::lock_guard lock(mutex_);
    std::erase_if(progress_.running, [&](const RunningPair& one) { return one.name == pair.name; });
    Outcome& outcome = outcomes_[i];
    if (const int code = exit_code_of(job, pair.name); code == Cancelled) {
      is_cancelled_ = true;
    } else {
      outcome.state = code == Done ? "done" : "failed";
      if (code != Done) outcome.why = job.failure().reason() + ": " + job.failure().message();
      ++progress_.done;
      progress_.failed += code != Done;
      ++done_now_;
      seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      progress_.seconds_a_pair = seconds_ / static_cast<double>(done_now_);
      // Every pair's end is told, however soon the next one's follows.
      if (jobs_ > 1) show_all();
    }
    display_.finish();
    write_summary(outcomes_, request_.out);
  }

  void show(const Pair& pair, const v1::RegistrationJob& now) {
    std::lock_guard lock(mutex_);
    for (RunningPair& one : progress_.running) {
      if (one.name != pair.name) continue;
      one.fraction = now.state() == v1::JOB_STATE_SUCCEEDED ? 1 : std::max(one.fraction, now.progress().fraction());
      one.seconds_left = now.state() == v1::JOB_STATE_RUNNING ? now.progress().seconds_left() : -1;
    }
    if (jobs_ == 1) {
      display_.lead(list_progress(progress_) + "; " + pair.name + ": ");
      display_.show(now);
    } else {
      show_all();
    }
  }

  void show_all() {
    std::string phase = std::to_string(progress_.done) + ' ';
    for (const RunningPair& one : progress_.running) phase += one.name + ' ';
    display_.show_text(list_progress(progress_), phase);
  }

  const std::vector<Pair>& pairs_;
  const PairsRequest& request_;
  const int jobs_;
  std::vector<Outcome>& outcomes_;
  Registrar registrar_;

  std::mutex mutex_;  ///< of all that follows, and of outcomes_
  ProgressDisplay display_;
  ListProgress progress_;
  std::size_t next_ = 0, done_now_ = 0;
  double seconds_ = 0;
  bool is_cancelled_ = false;
  std::exception_ptr problem_;
};

}  // namespace

int register_pairs(const PairsRequest& request) {
  return register_pairs(read_pairs(request.pairs, request.job), request);
}

int register_pairs(const std::vector<Pair>& pairs, const PairsRequest& request) {
  // A night's work is not begun when one of its pairs cannot be done.
  for (const Pair& pair : pairs) {
    try {
      make_spec(pair.job);
      check_inputs(pair.job);
      refuse_inputs_among_results(pair.job, request.out / pair.name);
    } catch (const InvalidInput& error) {
      throw InvalidInput(pair.name + ": " + error.what());
    }
  }
  const ResultFolder folder(request.out);
  std::vector<Outcome> outcomes;
  std::size_t done_before = 0;
  for (const Pair& pair : pairs) {
    const bool is_there = is_done(pair, request.out / pair.name);
    done_before += is_there;
    outcomes.push_back({&pair, is_there ? "done" : "", ""});
  }
  if (done_before > 0) std::cerr << done_before << " of " << pairs.size() << " pairs are done already" << std::endl;
  if (done_before < pairs.size()) {
    try {
      const int jobs = jobs_at_once(pairs, request, pairs.size() - done_before);
      if (PairList(pairs, request, jobs, outcomes).run() == Cancelled) {
        write_summary(outcomes, request.out);
        return Cancelled;
      }
    } catch (...) {
      write_summary(outcomes, request.out);
      throw;
    }
  }
  write_summary(outcomes, request.out);
  const auto failed =
      std::count_if(outcomes.begin(), outcomes.end(), [](const Outcome& one) { return one.state == "failed"; });
  if (request.output == PairsOutput::Silent) {
    // The caller has a table of its own.
  } else if (request.as_json) {
    nlohmann::json list = nlohmann::json::array();
    for (const Outcome& outcome : outcomes) {
      nlohmann::json one{{"name", outcome.pair->name}, {"state", outcome.state}};
      if (outcome.state == "done") one["report"] = read_report(request.out / outcome.pair->name / "report.json");
      if (!outcome.why.empty()) one["reason"] = outcome.why;
      list.push_back(one);
    }
    std::cout << list.dump(2) << std::endl;
  } else {
    std::cout << pairs.size() - static_cast<std::size_t>(failed) << " of " << pairs.size() << " pairs done, written to "
              << request.out.string() << "; summary.csv there has a line for each" << std::endl;
  }
  if (failed == 0) return Done;
  std::cerr << "saltus: " << failed << " of " << pairs.size() << " pairs failed; summary.csv says why" << std::endl;
  return JobFailed;
}

}  // namespace saltus::cli
