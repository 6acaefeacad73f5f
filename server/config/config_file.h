#pragma once

#include <CLI/CLI.hpp>

#include <istream>
#include <string>
#include <vector>

namespace saltus::server {

/// The file of --config: lines of `name = value`, where a name is an option without its dashes and the value goes to
/// the end of the line; lines that begin with # are comments. What may be given several times stands on several lines;
/// a flag is true or false. The command line goes before the file.
class ConfigFile final : public CLI::Config {
 public:
  /// `app` has the options, and has to outlive this.
  explicit ConfigFile(const CLI::App& app) : app_(app) {}

  /// What the file says. Throws InvalidInput that names the line.
  std::vector<CLI::ConfigItem> from_config(std::istream& in) const override;

  /// A file with every option, its explanation above it: what was given as it is, what was not as a comment with its
  /// default, or with nothing where there is none. The arguments say nothing here.
  std::string to_config(const CLI::App* app, bool, bool, std::string) const override;

 private:
  const CLI::App& app_;
};

}  // namespace saltus::server
