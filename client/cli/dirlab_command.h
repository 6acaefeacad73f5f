#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus dirlab`: the paper's table from the user's own DIR-Lab packs.
void add_dirlab_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
