#pragma once

#include <string>
#include <vector>

namespace saltus::cli {

/// Which of `words` was most likely meant by `typed`: the first of those with the fewest letters left out, put in,
/// exchanged or swapped with their neighbour, two at most and fewer than half of it. Empty when there is none.
std::string closest_word(const std::string& typed, const std::vector<std::string>& words);

}  // namespace saltus::cli
