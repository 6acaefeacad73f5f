#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::cli {

/// An option as a shell or a manual shows it.
struct OptionInfo {
  std::vector<std::string> names;  ///< with their dashes; a positional argument has its name alone
  std::string value;               ///< what its value is called, "" when it takes none
  std::string description;
  std::string default_value;         ///< "" for none
  std::vector<std::string> choices;  ///< the values that it knows, when it knows them all
  bool is_positional = false;
  bool takes_file = false;
};

struct CommandInfo {
  std::vector<std::string> path;  ///< {"register"}, {"server", "info"}
  std::string description, footer;
  std::string group;  ///< description of what stands above it, "" at the top: of "server" for {"server", "info"}
  std::vector<OptionInfo> options;
};

/// The commands that do something, with their options, in the order in which help lists them.
std::vector<CommandInfo> commands_of(const CLI::App& app);

/// "--points-space" -> "SALTUS_POINTS_SPACE".
std::string environment_name(const std::string& option);

/// Lets an environment variable stand in for every option of the command that `arguments` names, before what a settings
/// file says of it.
void take_options_from_environment(CLI::App& app, int argument_count, const char* const* arguments);

}  // namespace saltus::cli
