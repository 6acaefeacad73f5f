#pragma once

#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace saltus::benchmark {

/// What one run gave.
struct Row {
  std::string name;
  std::string outcome;                  ///< how the registration ended, or the sentence it was refused with
  std::vector<std::string> complaints;  ///< what must not happen and did; empty when all is well
  std::vector<std::pair<std::string, double>> figures;  ///< by the keys of a table's columns

  void add(std::string key, double value) { figures.emplace_back(std::move(key), value); }
  const double* find(const std::string& key) const;
};

struct Column {
  std::string key, title;
  int digits = 2;
};

/// A Markdown table; figures that a row does not have are left empty. Columns that no row has are left out.
void print_markdown(std::ostream& out, const std::vector<Column>& columns, const std::vector<Row>& rows);

/// All figures of all rows, whether or not they have a column.
nlohmann::json as_json(const std::vector<Row>& rows);

}  // namespace saltus::benchmark
