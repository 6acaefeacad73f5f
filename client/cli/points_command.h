#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus points`: carries landmarks through a transform. Runs here, without a server.
void add_points_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
