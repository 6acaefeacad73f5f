#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus watch`: follows a job until it ends.
void add_watch_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
