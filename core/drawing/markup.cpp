#include "core/drawing/markup.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace saltus::drawing {

std::string escaped(std::string_view text) {
  std::string safe;
  for (char letter : text) switch (letter) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      case '\'':
        safe += "&#39;";
        break;
      default:
        safe += letter;
    }
  return safe;
}

std::string number(double value, int significant) {
  if (!std::isfinite(value)) return "n/a";
  if (value == 0) return "0";
  const double size = std::abs(value);
  char text[64];
  if (size < 1e-4 || size >= 1e6) {
    std::snprintf(text, sizeof text, "%.*e", significant - 1, value);
  } else {
    const int before_point = static_cast<int>(std::floor(std::log10(size))) + 1;
    std::snprintf(text, sizeof text, "%.*f", std::max(0, significant - before_point), value);
  }
  std::string shown = text;
  // Zeros after the point say nothing: 9.00 is 9.
  if (shown.find('.') != std::string::npos && shown.find('e') == std::string::npos) {
    shown.erase(shown.find_last_not_of('0') + 1);
    if (shown.back() == '.') shown.pop_back();
  }
  return shown;
}

std::string percentage(double share) { return number(100 * share, 2) + " %"; }

std::string table(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows) {
  std::string html = "<div class=\"scroll\"><table><thead><tr>";
  for (const std::string& cell : head) html += "<th>" + escaped(cell) + "</th>";
  html += "</tr></thead><tbody>";
  for (const auto& row : rows) {
    html += "<tr>";
    for (const std::string& cell : row) html += "<td>" + escaped(cell) + "</td>";
    html += "</tr>";
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace saltus::drawing
