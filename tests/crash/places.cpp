#include "tests/crash/places.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <limits>
#include <ostream>
#include <vector>

namespace saltus::crash {
namespace {

constexpr Place places[] = {
    {"sync.before", 8},
    {"sync.after", 8},
    {"sync_data.before", 3},
    {"sync_data.after", 3},
    {"rename.before", 4},
    {"rename.after", 4},
    {"remove.before", 2},
    {"remove.after", 2},
    {"expire.before", 2, true},
    {"expire.after", 2, true},
    {"commit.before", 10},
    {"commit.after", 10},
    {"acknowledge.after", 12},
    {"database.sync.before", 10},
    {"database.sync.after", 10},
    {"launch.before", 2},
    {"launch.after", 2},
    {"reap.before", 2},
    {"worker.acquired", 1},
    {"worker.checkpoint.before", 2},
    {"worker.checkpoint.after", 2},
    {"worker.upload.before", 2},
    {"worker.upload.after", 2},
    {"worker.complete.before", 1},
    {"worker.complete.after", 1},
};

int random_below(std::mt19937& generator, std::size_t count) {
  return std::uniform_int_distribution<int>(0, static_cast<int>(count) - 1)(generator);
}

}  // namespace

Places::Choice Places::choose(std::mt19937& generator) {
  const int few = fewest();
  std::vector<const Place*> next;
  for (const Place& place : places)
    if (past_[place.name].deaths == few) next.push_back(&place);
  Choice choice;
  choice.place = next[static_cast<std::size_t>(random_below(generator, next.size()))];
  if (!past_[choice.place->name].was_missed)
    choice.pass = 1 + random_below(generator, static_cast<std::size_t>(choice.place->passes));
  return choice;
}

void Places::died(const Choice& choice, int processes) {
  Past& past = past_[choice.place->name];
  past.deaths += processes;
  past.was_missed = processes == 0;
}

int Places::fewest() const {
  int few = std::numeric_limits<int>::max();
  for (const Place& place : places) {
    const auto found = past_.find(place.name);
    few = std::min(few, found == past_.end() ? 0 : found->second.deaths);
  }
  return few;
}

void Places::print(std::ostream& out) const {
  for (const auto& [name, past] : past_) out << ' ' << name << ' ' << past.deaths;
}

int deaths_in(const std::filesystem::path& record) {
  std::ifstream in(record);
  return static_cast<int>(std::count(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>(), '\n'));
}

}  // namespace saltus::crash
