#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus submit`: sends a job to a daemon, prints its id and does not wait.
void add_submit_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
