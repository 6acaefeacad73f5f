#include "server/config/config_file.h"

#include "core/support/errors.h"

#include <algorithm>
#include <sstream>

namespace saltus::server {
namespace {

constexpr std::size_t kWidth = 100;
constexpr const char* kBlank = " \t\r";

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(kBlank);
  return begin == std::string::npos ? "" : text.substr(begin, text.find_last_not_of(kBlank) - begin + 1);
}

/// `text` as comment lines.
std::string commented(const std::string& text) {
  std::istringstream words(text);
  std::string comment, line = "#", word;
  while (words >> word) {
    if (line.size() + 1 + word.size() > kWidth) {
      comment += line + "\n";
      line = "#";
    }
    line += " " + word;
  }
  return comment + line + "\n";
}

bool is_flag(const CLI::Option& option) { return option.get_expected_max() == 0; }

bool is_repeatable(const CLI::Option& option) {
  return option.get_multi_option_policy() == CLI::MultiOptionPolicy::TakeAll;
}

/// "name = value", or "name =".
std::string assignment(const std::string& name, const std::string& value) {
  return name + (value.empty() ? " =" : " = " + value) + "\n";
}

}  // namespace

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& in) const {
  std::vector<CLI::ConfigItem> items;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const auto refuse = [&](const std::string& reason) {
      throw InvalidInput("line " + std::to_string(number) + " of --config: " + reason);
    };
    line = trimmed(line);
    if (line.empty() || line.front() == '#') continue;
    const auto equals = line.find('=');
    if (equals == std::string::npos) refuse("'" + line + "' is no 'name = value'");
    const std::string name = trimmed(line.substr(0, equals)), value = trimmed(line.substr(equals + 1));
    const CLI::Option* option = name.empty() ? nullptr : app_.get_option_no_throw("--" + name);
    if (!option || !option->get_configurable())
      refuse("'" + name + "' is no option of this file; saltusd --print-config shows all");
    if (value.empty()) refuse(name + " has no value; give one, or make the line a comment with #");
    if (is_flag(*option) && value != "true" && value != "false")
      refuse(name + " is '" + value + "'; it must be true or false");
    const auto same = std::find_if(items.begin(), items.end(), [&](const auto& item) { return item.name == name; });
    if (same == items.end())
      items.push_back({{}, name, {value}});
    else if (is_repeatable(*option))
      same->inputs.push_back(value);
    else
      refuse(name + " is given a second time; leave one");
  }
  return items;
}

std::string ConfigFile::to_config(const CLI::App* app, bool, bool, std::string) const {
  std::string text =
      "# The configuration of saltusd; use it with saltusd --config FILE.\n"
      "# A line that begins with # is a comment: these show the defaults. The command line goes before this file.\n";
  for (const CLI::Option* option : app->get_options()) {
    if (!option->get_configurable()) continue;
    const std::string& name = option->get_lnames().front();
    const bool has_default = !is_flag(*option);
    text += "\n" + commented(option->get_description());
    if (option->count() == 0)
      text += "#" + assignment(name, has_default ? option->get_default_str() : "false");
    else if (!has_default)
      text += assignment(name, option->as<bool>() ? "true" : "false");
    else
      for (const std::string& value : option->results()) text += assignment(name, value);
  }
  return text;
}

}  // namespace saltus::server
