#include "tests/benchmark/service_load/figures.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <numeric>
#include <ostream>
#include <sstream>

#include <unistd.h>

namespace saltus::benchmark {

void print_figures(std::ostream& out, const std::vector<Figure>& figures) {
  out << "| what | measured | target |\n|---|---:|---:|\n";
  for (const Figure& figure : figures) {
    out << "| " << figure.name << " | " << std::fixed << std::setprecision(figure.digits) << figure.value << ' '
        << figure.unit << " | ";
    if (figure.target != Figure::kNoTarget)
      out << (figure.is_missed() ? "**missed** " : "") << "< " << std::setprecision(0) << figure.target << ' '
          << figure.unit;
    out << " |\n";
  }
}

nlohmann::json as_json(const std::vector<Figure>& figures) {
  auto list = nlohmann::json::array();
  for (const Figure& figure : figures) {
    nlohmann::json entry{{"name", figure.name}, {"value", figure.value}, {"unit", figure.unit}};
    if (figure.target != Figure::kNoTarget) {
      entry["target"] = figure.target;
      entry["is_missed"] = figure.is_missed();
    }
    list.push_back(std::move(entry));
  }
  return list;
}

double quantile(std::vector<double> samples, double p) {
  const auto nth = samples.begin() + static_cast<std::ptrdiff_t>(p * static_cast<double>(samples.size() - 1));
  std::nth_element(samples.begin(), nth, samples.end());
  return *nth;
}

double mean(const std::vector<double>& samples) {
  return std::accumulate(samples.begin(), samples.end(), 0.0) / static_cast<double>(samples.size());
}

void Series::add(double time, double value) {
  times_.push_back(time);
  values_.push_back(value);
}

double Series::most() const { return *std::max_element(values_.begin(), values_.end()); }

double Series::mean_between(double begin, double end) const {
  const double first = times_.front(), length = times_.back() - first;
  std::vector<double> chosen;
  for (std::size_t i = 0; i < times_.size(); ++i)
    if (times_[i] >= first + begin * length && times_[i] <= first + end * length) chosen.push_back(values_[i]);
  return mean(chosen);
}

double Series::slope_of_second_half() const {
  const std::size_t begin = times_.size() / 2;
  const auto count = static_cast<double>(times_.size() - begin);
  double mean_time = 0, mean_value = 0, covariance = 0, variance = 0;
  for (std::size_t i = begin; i < times_.size(); ++i) {
    mean_time += times_[i] / count;
    mean_value += values_[i] / count;
  }
  for (std::size_t i = begin; i < times_.size(); ++i) {
    covariance += (times_[i] - mean_time) * (values_[i] - mean_value);
    variance += (times_[i] - mean_time) * (times_[i] - mean_time);
  }
  return variance > 0 ? 60 * covariance / variance : 0;
}

double resident_mebibytes(pid_t process) {
  double total = 0, resident = 0;
  std::ifstream("/proc/" + std::to_string(process) + "/statm") >> total >> resident;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / (1 << 20);
}

double open_files(pid_t process) {
  const std::filesystem::directory_iterator files("/proc/" + std::to_string(process) + "/fd");
  return static_cast<double>(std::distance(begin(files), end(files)));
}

double processor_seconds(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string line;
  std::getline(file, line);
  // The name of the program may have anything in it; what follows it is plain. Fields 14 and 15 are the times.
  std::istringstream rest(line.substr(line.rfind(')') + 1));
  std::string skipped;
  for (int field = 3; field < 14; ++field) rest >> skipped;
  double user = 0, system = 0;
  rest >> user >> system;
  return (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

double busy_seconds_of_machine() {
  std::ifstream file("/proc/stat");
  std::string name;
  double user = 0, nice = 0, system = 0, idle = 0, waiting = 0, interrupts = 0, soft_interrupts = 0;
  file >> name >> user >> nice >> system >> idle >> waiting >> interrupts >> soft_interrupts;
  return (user + nice + system + interrupts + soft_interrupts) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

double load_average() {
  double load = 0;
  std::ifstream("/proc/loadavg") >> load;
  return load;
}

}  // namespace saltus::benchmark
