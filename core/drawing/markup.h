#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace saltus::drawing {

/// Text that means itself in HTML and SVG, quotes included.
std::string escaped(std::string_view text);

/// `significant` digits, without an exponent between 1e-4 and 1e6; "n/a" for what is not finite.
std::string number(double value, int significant = 3);

/// 0.0123 -> "1.2 %".
std::string percentage(double share);

/// A table whose first column holds names. Cells are escaped.
std::string table(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows);

}  // namespace saltus::drawing
