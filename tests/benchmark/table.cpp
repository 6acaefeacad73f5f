#include "tests/benchmark/table.h"

#include <algorithm>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <ostream>

namespace saltus::benchmark {

const double* Row::find(const std::string& key) const {
  const auto found =
      std::find_if(figures.begin(), figures.end(), [&](const auto& entry) { return entry.first == key; });
  return found == figures.end() ? nullptr : &found->second;
}

void print_markdown(std::ostream& out, const std::vector<Column>& columns, const std::vector<Row>& rows) {
  std::vector<Column> used;
  for (const Column& column : columns)
    if (std::any_of(rows.begin(), rows.end(), [&](const Row& row) { return row.find(column.key); }))
      used.push_back(column);
  out << "| case | outcome |";
  for (const Column& column : used) out << ' ' << column.title << " |";
  out << "\n|---|---|";
  for (std::size_t k = 0; k < used.size(); ++k) out << "---:|";
  out << '\n';
  for (const Row& row : rows) {
    out << "| " << row.name << " | " << row.outcome;
    for (const std::string& complaint : row.complaints) out << " **" << complaint << "**";
    out << " |";
    for (const Column& column : used) {
      out << ' ';
      if (const double* value = row.find(column.key)) out << std::fixed << std::setprecision(column.digits) << *value;
      out << " |";
    }
    out << '\n';
  }
}

nlohmann::json as_json(const std::vector<Row>& rows) {
  nlohmann::json list = nlohmann::json::array();
  for (const Row& row : rows) {
    nlohmann::json figures = nlohmann::json::object();
    for (const auto& [key, value] : row.figures) figures[key] = value;
    list.push_back(
        {{"case", row.name}, {"outcome", row.outcome}, {"complaints", row.complaints}, {"figures", figures}});
  }
  return list;
}

}  // namespace saltus::benchmark
