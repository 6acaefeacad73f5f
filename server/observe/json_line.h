#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace saltus::server {

/// Builds one JSON object on one line, members in the order of adding.
class JsonLine {
 public:
  JsonLine& add(std::string_view name, std::string_view text);
  JsonLine& add(std::string_view name, const char* text) { return add(name, std::string_view(text)); }
  JsonLine& add(std::string_view name, std::int64_t number);
  JsonLine& add(std::string_view name, const std::vector<std::string>& texts);
  /// Without a line's end.
  std::string str() const { return "{" + members_ + "}"; }

 private:
  void begin(std::string_view name);
  std::string members_;
};

/// A JSON string with its quotes. Bytes that are no UTF-8 become question marks.
std::string json_string(std::string_view text);

}  // namespace saltus::server
