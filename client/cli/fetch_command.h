#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus fetch`: writes what a job has made to a folder.
void add_fetch_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
