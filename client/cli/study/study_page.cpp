#include "client/cli/study/study_page.h"

#include "core/drawing/markup.h"
#include "core/drawing/page_style.h"
#include "core/image_io/temporary_file.h"
#include "core/support/errors.h"

#include <nlohmann/json.hpp>

#include <fstream>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;
using drawing::escaped;

void write_file(const fs::path& file, const std::string& content) {
  TemporaryFile temporary(file);
  std::ofstream out(temporary.path(), std::ios::binary);
  out << content;
  out.close();
  if (!out) throw FileError(file.string() + " cannot be written");
  temporary.take_place();
}

std::string markdown_row(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (std::string cell : cells) {
    for (std::size_t at = 0; (at = cell.find('|', at)) != std::string::npos; at += 2) cell.insert(at, "\\");
    line += ' ' + cell + " |";
  }
  return line + '\n';
}

}  // namespace

std::string to_markdown(const std::vector<StudyTable>& tables) {
  std::string text;
  for (const StudyTable& table : tables) {
    text += "## " + table.title + "\n\n" + table.explanation + "\n\n" + markdown_row(table.head) + '|';
    for (std::size_t i = 0; i < table.head.size(); ++i) text += i == 0 ? "---|" : "---:|";
    text += '\n';
    for (const auto& row : table.rows) text += markdown_row(row);
    text += '\n';
  }
  return text;
}

std::string to_html(const Study& study) {
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta http-equiv=\"Content-Security-Policy\" "
      "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'\">"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>" +
      escaped(study.title) + "</title><style>" + drawing::page_style + "</style></head><body><main>\n<h1>" +
      escaped(study.title) + "</h1>\n<p class=\"lead\">" + escaped(study.introduction) + "</p>\n";
  for (const std::string& note : study.notes) html += "<p>" + escaped(note) + "</p>\n";
  for (const StudyTable& table : study.tables)
    html += "<section><h2>" + escaped(table.title) + "</h2><p>" + escaped(table.explanation) + "</p>" +
            drawing::table(table.head, table.rows) + "</section>\n";
  for (const Figure& figure : study.figures)
    html += "<section><h2>" + escaped(figure.title) + "</h2><p>" + escaped(figure.caption) +
            "</p><img class=\"sheet\" alt=\"" + escaped(figure.title) + "\" src=\"" +
            drawing::data_uri(figure.picture) + "\"></section>\n";
  return html + "</main></body></html>\n";
}

void write_study(const Study& study, const nlohmann::json& numbers, const fs::path& out) {
  fs::create_directories(out / "figures");
  for (const Figure& figure : study.figures)
    write_file(out / "figures" / (figure.name + ".png"), drawing::encode_png(figure.picture));
  std::string text = "# " + study.title + "\n\n" + study.introduction + "\n\n";
  for (const std::string& note : study.notes) text += note + "\n\n";
  text += to_markdown(study.tables);
  for (const Figure& figure : study.figures)
    text += "## " + figure.title + "\n\n![" + figure.title + "](figures/" + figure.name + ".png)\n\n" + figure.caption +
            "\n\n";
  write_file(out / "study.md", text);
  write_file(out / "study.json", numbers.dump(2) + '\n');
  write_file(out / "study.html", to_html(study));
}

}  // namespace saltus::cli
