#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus cancel`: asks for a job's end.
void add_cancel_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
