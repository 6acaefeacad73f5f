#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus study paper` and `saltus study liver`: figures and tables from one command.
void add_study_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
