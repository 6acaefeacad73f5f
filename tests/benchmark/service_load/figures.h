#pragma once

#include <nlohmann/json_fwd.hpp>

#include <iosfwd>
#include <limits>
#include <string>
#include <vector>

#include <sys/types.h>

namespace saltus::benchmark {

/// One line of the table.
struct Figure {
  static constexpr double kNoTarget = std::numeric_limits<double>::infinity();

  std::string name;
  double value = 0;
  std::string unit;
  double target = kNoTarget;  ///< the value has to be below it
  int digits = 1;

  bool is_missed() const { return value >= target; }
};

/// A Markdown table.
void print_figures(std::ostream& out, const std::vector<Figure>& figures);
nlohmann::json as_json(const std::vector<Figure>& figures);

/// The value that the share `p` of the samples does not exceed; samples must not be empty.
double quantile(std::vector<double> samples, double p);
double mean(const std::vector<double>& samples);

/// Values that were measured at times, in seconds.
class Series {
 public:
  void add(double time, double value);
  double most() const;
  /// Mean value from the share `begin` of the time to the share `end`.
  double mean_between(double begin, double end) const;
  /// Per minute, by least squares over the second half of the time.
  double slope_of_second_half() const;

 private:
  std::vector<double> times_, values_;
};

/// What a process has in memory, MiB.
double resident_mebibytes(pid_t process);
/// How many descriptors a process has.
double open_files(pid_t process);
/// What a process has used of all cores so far, in seconds.
double processor_seconds(pid_t process);
/// What this process and all the others have used of all cores since the machine started.
double busy_seconds_of_machine();
/// How many threads wanted a core, over the last minute.
double load_average();

}  // namespace saltus::benchmark
