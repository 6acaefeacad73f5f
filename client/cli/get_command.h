#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus get`: prints what is known of a job.
void add_get_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
