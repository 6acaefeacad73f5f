#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus server info | drain | gc | fsck`: what administrators ask a daemon for.
void add_server_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
