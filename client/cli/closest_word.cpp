#include "client/cli/closest_word.h"

#include <algorithm>

namespace saltus::cli {
namespace {

/// Optimal string alignment distance, row by row.
std::size_t changes(const std::string& a, const std::string& b) {
  std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i)
    for (std::size_t j = 1; j <= b.size(); ++j) {
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a[i - 1] != b[j - 1])});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  return d[a.size()][b.size()];
}

}  // namespace

std::string closest_word(const std::string& typed, const std::vector<std::string>& words) {
  const auto letters =
      static_cast<std::size_t>(std::count_if(typed.begin(), typed.end(), [](char c) { return c != '-'; }));
  std::string best;
  std::size_t fewest = std::min<std::size_t>(3, (letters + 1) / 2);  // one more than is allowed
  for (const std::string& word : words)
    if (const std::size_t needed = changes(typed, word); needed < fewest) {
      fewest = needed;
      best = word;
    }
  return best;
}

}  // namespace saltus::cli
