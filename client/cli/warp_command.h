#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus warp`: carries an image through a transform. Runs here, without a server.
void add_warp_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
