#include "client/cli/command_tree.h"

#include "core/evaluation/warp_image.h"
#include "core/registration/options.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <map>
#include <memory>
#include <set>

namespace saltus::cli {
namespace {

template <class Value>
std::vector<std::string> names(const std::vector<Value>& values) {
  std::vector<std::string> all;
  for (const Value& value : values) all.push_back(to_string(value));
  return all;
}

std::vector<std::string> choices_of(const std::string& option) {
  static const std::map<std::string, std::vector<std::string>> choices{
      {"--model", names(all_models())},
      {"--similarity", names(all_similarities())},
      {"--preset", names(all_presets())},
      {"--affine", {"none", "rigid", "affine"}},
      {"--format", {"mha", "nii.gz", "nrrd"}},
      {"--priority", {"low", "normal", "high"}},
      {"--interpolation", names(std::vector{Interpolation::Linear, Interpolation::Nearest, Interpolation::BSpline})},
      {"--points-space", {"lps", "ras"}},
      {"--points-unit", {"mm", "voxel"}},
      {"--allow", {"spacing", "overlap", "points"}},
      {"--interface", {"line", "circle"}},
      {"kind", {"rectangle", "wheel", "slip", "thorax", "smooth"}},
      {"shell", {"bash", "zsh", "fish"}}};
  const auto found = choices.find(option);
  return found == choices.end() ? std::vector<std::string>{} : found->second;
}

OptionInfo describe(const CLI::Option& option) {
  OptionInfo info;
  info.is_positional = option.get_positional();
  if (info.is_positional) {
    info.names = {option.get_name(true)};
    info.choices = choices_of(info.names.back());
  } else {
    for (const std::string& name : option.get_snames()) info.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) info.names.push_back("--" + name);
    if (!info.names.empty()) info.choices = choices_of(info.names.back());
  }
  if (option.get_items_expected_max() != 0) {  // a flag expects none
    // Checks put themselves behind the name: "IMAGE:FILE".
    const std::string type = option.get_type_name();
    info.value = type.empty() ? "VALUE" : type.substr(0, type.find(':'));
    if (info.value == "TEXT" || info.value == "FLOAT" || info.value == "INT" || info.value == "UINT")
      info.value = "VALUE";
    info.default_value = option.get_default_str();
  }
  for (const char* file : {"IMAGE", "CSV", "DIR", "FILE", "FIELD", "P.csv", "Q.csv"})
    info.takes_file = info.takes_file || info.value == file;
  info.description = option.get_description();
  return info;
}

void collect(const CLI::App& app, std::vector<std::string> path, std::vector<CommandInfo>& all) {
  const auto below = app.get_subcommands({});
  if (!path.empty() && below.empty()) {
    CommandInfo command{path, app.get_description(), app.get_footer(), "", {}};
    if (path.size() > 1) command.group = app.get_parent()->get_description();
    for (const CLI::Option* option : app.get_options({})) command.options.push_back(describe(*option));
    all.push_back(std::move(command));
  }
  for (const CLI::App* sub : below) {
    auto deeper = path;
    deeper.push_back(sub->get_name());
    collect(*sub, deeper, all);
  }
}

/// A settings file without what the environment says for the command that runs: the parser would take the file first.
class FileBehindEnvironment : public CLI::ConfigTOML {
 public:
  explicit FileBehindEnvironment(const CLI::App* command) {
    for (const CLI::Option* option : command->get_options({})) {
      const char* const value = option->get_envname().empty() ? nullptr : std::getenv(option->get_envname().c_str());
      if (value && *value) given_.insert(option->get_lnames().front());
    }
    for (; command->get_parent(); command = command->get_parent()) path_.insert(path_.begin(), command->get_name());
  }

  std::vector<CLI::ConfigItem> from_config(std::istream& in) const override {
    std::vector<CLI::ConfigItem> items = CLI::ConfigTOML::from_config(in);
    std::erase_if(items,
                  [this](const CLI::ConfigItem& item) { return item.parents == path_ && given_.contains(item.name); });
    return items;
  }

 private:
  std::vector<std::string> path_;
  std::set<std::string> given_;
};

}  // namespace

std::vector<CommandInfo> commands_of(const CLI::App& app) {
  std::vector<CommandInfo> all;
  collect(app, {}, all);
  return all;
}

std::string environment_name(const std::string& option) {
  std::string name = "SALTUS_";
  for (char letter : option.substr(option.find_first_not_of('-')))
    name += letter == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
  return name;
}

void take_options_from_environment(CLI::App& app, int argument_count, const char* const* arguments) {
  // Of the chosen command only: what stands for one command's option is none of the others' business.
  CLI::App* command = &app;
  for (int i = 1; i < argument_count; ++i) {
    const auto below = command->get_subcommands(
        [word = std::string(arguments[i])](const CLI::App* sub) { return sub->get_name() == word; });
    if (!below.empty()) command = below.front();
  }
  if (command == &app) return;
  for (CLI::Option* option : command->get_options({})) {
    if (option->get_positional() || option->get_lnames().empty() || !option->get_envname().empty()) continue;
    const std::string& name = option->get_lnames().front();
    // Where help is asked for, it is given; and no address means a private daemon to `register`.
    if (name == "help" || (name == "server" && command->get_name() == "register")) continue;
    option->envname(environment_name(name));
  }
  app.config_formatter(std::make_shared<FileBehindEnvironment>(command));
}

}  // namespace saltus::cli
