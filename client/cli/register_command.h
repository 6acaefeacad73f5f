#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// `saltus register`: registers two images and writes the result to a folder, on a daemon of its own or a given one.
void add_register_command(CLI::App& app, int& exit_code);

}  // namespace saltus::cli
