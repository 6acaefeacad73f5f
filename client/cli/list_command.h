#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus list`: prints the newest jobs of a daemon.
void add_list_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
