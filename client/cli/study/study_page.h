#pragma once

#include "client/cli/study/figure.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace saltus::cli {

/// A table as people read it: cells are text already. The first column holds names.
struct StudyTable {
  std::string title;
  std::string explanation;
  std::vector<std::string> head;
  std::vector<std::vector<std::string>> rows;
};

struct Study {
  std::string title;
  std::string introduction;
  std::vector<std::string> notes;  ///< what was left out and why, and the like
  std::vector<StudyTable> tables;
  std::vector<Figure> figures;
};

/// Markdown tables with their titles.
std::string to_markdown(const std::vector<StudyTable>& tables);

/// One page that loads nothing: the pictures are in it.
std::string to_html(const Study& study);

/// Writes `figures/NAME.png`, `study.html`, `study.md` and `study.json` below `out`. Throws FileError.
void write_study(const Study& study, const nlohmann::json& numbers, const std::filesystem::path& out);

}  // namespace saltus::cli
