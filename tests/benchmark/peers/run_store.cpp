#include "tests/benchmark/peers/run_store.h"

#include <algorithm>
#include <fstream>
#include <stdexcept>

namespace saltus::benchmark {
namespace {

bool is_same_place(const PeerRun& a, const PeerRun& b) {
  return a.pair == b.pair && a.method() == b.method() && a.threads == b.threads;
}

nlohmann::json as_json(const PeerRun& run) {
  nlohmann::json figures = nlohmann::json::object();
  for (const auto& [key, value] : run.row.figures) figures[key] = value;
  return {{"scene", run.scene},         {"pair", run.pair},
          {"family", run.family},       {"choice", run.choice},
          {"threads", run.threads},     {"setting", run.setting},
          {"outcome", run.row.outcome}, {"complaints", run.row.complaints},
          {"figures", figures}};
}

PeerRun from_json(const nlohmann::json& json) {
  PeerRun run;
  run.scene = json.at("scene");
  run.pair = json.at("pair");
  run.family = json.at("family");
  run.choice = json.at("choice");
  run.threads = json.at("threads");
  run.setting = json.at("setting");
  run.row.name = run.pair + ", " + run.method();
  run.row.outcome = json.at("outcome");
  run.row.complaints = json.at("complaints").get<std::vector<std::string>>();
  for (const auto& [key, value] : json.at("figures").items()) run.row.add(key, value.get<double>());
  return run;
}

}  // namespace

RunStore::RunStore(std::filesystem::path file) : file_(std::move(file)) {
  if (!std::filesystem::exists(file_)) return;
  try {
    std::ifstream in(file_);
    const nlohmann::json json = nlohmann::json::parse(in);
    for (const nlohmann::json& run : json.at("runs")) runs_.push_back(from_json(run));
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(file_.string() + " does not hold runs of this benchmark (" + error.what() +
                             "); take it away or name another --out");
  }
}

const PeerRun* RunStore::find(const PeerRun& wanted) const {
  const auto found = std::find_if(runs_.begin(), runs_.end(), [&](const PeerRun& run) {
    return is_same_place(run, wanted) && run.setting == wanted.setting && !run.row.figures.empty();
  });
  return found == runs_.end() ? nullptr : &*found;
}

void RunStore::put(PeerRun run) {
  const auto place =
      std::find_if(runs_.begin(), runs_.end(), [&](const PeerRun& old) { return is_same_place(old, run); });
  if (place == runs_.end())
    runs_.push_back(std::move(run));
  else
    *place = std::move(run);
  nlohmann::json json = {{"runs", nlohmann::json::array()}};
  for (const PeerRun& each : runs_) json["runs"].push_back(as_json(each));
  const std::filesystem::path beside = file_.string() + ".new";
  std::ofstream out(beside);
  out << json.dump(1) << '\n';
  out.close();
  if (!out) throw std::runtime_error(beside.string() + " could not be written");
  std::filesystem::rename(beside, file_);
}

}  // namespace saltus::benchmark
