#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus delete`: forgets a job that has ended, and what it made.
void add_delete_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
