#pragma once

#include "client/cli/command_tree.h"

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::cli {

/// Scripts that complete commands, options, the values of options that have names, and files.
std::string bash_completion(const std::vector<CommandInfo>& commands);
std::string zsh_completion(const std::vector<CommandInfo>& commands);
std::string fish_completion(const std::vector<CommandInfo>& commands);

/// `saltus completion bash|zsh|fish`, for the commands that `app` has when it runs.
void add_completion_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
