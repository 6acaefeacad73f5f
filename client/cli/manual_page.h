#pragma once

#include "client/cli/command_tree.h"

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::cli {

/// saltus(1) in roff, from the same descriptions that --help shows.
std::string manual_page(const std::vector<CommandInfo>& commands);

/// `saltus man`.
void add_manual_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
