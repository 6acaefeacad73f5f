#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus phantom`: makes a pair of images with known motion between them. Runs here, without a server.
void add_phantom_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
