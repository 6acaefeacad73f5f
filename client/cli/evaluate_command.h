#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus evaluate`: scores a transform. Runs here, without a server.
void add_evaluate_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
