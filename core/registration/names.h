#pragma once

#include "core/support/errors.h"

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace saltus {

/// The enumerators of an option with their names, in the order in which they are listed.
template <class Value>
using Names = std::vector<std::pair<Value, const char*>>;

/// Throws InvalidInput for a value that is not in the list.
template <class Value>
std::string name_of(const Names<Value>& names, Value value) {
  for (const auto& [candidate, name] : names)
    if (candidate == value) return name;
  throw InvalidInput("unnamed enumerator " + std::to_string(static_cast<int>(value)));
}

template <class Value>
std::vector<Value> values_of(const Names<Value>& names) {
  std::vector<Value> values;
  for (const auto& [value, name] : names) values.push_back(value);
  return values;
}

/// The inverse; `what` names the option in the error, which lists the names there are.
template <class Value>
Value value_of(const Names<Value>& names, std::string_view what, std::string_view text) {
  std::string all;
  for (const auto& [value, name] : names) {
    if (text == name) return value;
    all += (all.empty() ? "" : ", ") + std::string(name);
  }
  throw InvalidInput(std::string(what) + " is '" + std::string(text) + "'; it must be one of " + all);
}

}  // namespace saltus
