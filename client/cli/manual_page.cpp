#include "client/cli/manual_page.h"

#include "client/cli/command.h"

#include <CLI/CLI.hpp>

#include <iostream>
#include <sstream>

namespace saltus::cli {
namespace {

/// Text that means itself in roff: backslashes and dashes escaped, no line taken for a request.
std::string plain(const std::string& text) {
  std::string safe;
  bool is_at_start = true;
  for (char letter : text) {
    if (is_at_start && (letter == '.' || letter == '\'')) safe += "\\&";
    if (letter == '\\')
      safe += "\\e";
    else if (letter == '-')
      safe += "\\-";
    else
      safe += letter;
    is_at_start = letter == '\n';
  }
  return safe;
}

std::string name_of(const CommandInfo& command) {
  std::string name = "saltus";
  for (const std::string& word : command.path) name += ' ' + word;
  return name;
}

void write_option(std::ostream& page, const OptionInfo& option) {
  page << ".TP\n\\fB";
  for (std::size_t i = 0; i < option.names.size(); ++i) page << (i ? ", " : "") << plain(option.names[i]);
  page << "\\fR";
  if (!option.value.empty() && !option.is_positional) page << " \\fI" << plain(option.value) << "\\fR";
  page << '\n' << plain(option.description);
  if (!option.default_value.empty()) page << " (default " << plain(option.default_value) << ")";
  page << '\n';
}

}  // namespace

std::string manual_page(const std::vector<CommandInfo>& commands) {
  std::ostringstream page;
  page << ".TH SALTUS 1 \"\" \"saltus " SALTUS_VERSION
          "\" \"User commands\"\n"
          ".SH NAME\nsaltus \\- register images whose motion slides\n"
          ".SH SYNOPSIS\n\\fBsaltus\\fR [\\fB\\-\\-config\\fR \\fIFILE\\fR] \\fICOMMAND\\fR [\\fIOPTION\\fR ...]\n"
          ".SH DESCRIPTION\n"
       << plain(
              "Registers medical images with motion that slides along interfaces, such as lungs along the chest wall. "
              "A registration runs on a daemon, saltusd: one that is named by --server, or a private one that lives as "
              "long as the command. Displacements are world millimetres (LPS) on the fixed grid: fixed(x) corresponds "
              "to moving(x + u(x)).\n")
       << ".SH COMMANDS\n";
  for (const CommandInfo& command : commands) {
    page << ".SS " << plain(name_of(command)) << '\n' << plain(command.description) << ".\n";
    for (const OptionInfo& option : command.options) write_option(page, option);
    // Footers are laid out by hand: examples, line by line.
    if (!command.footer.empty()) page << ".PP\n.nf\n" << plain(command.footer) << "\n.fi\n";
  }
  page << ".SH ENVIRONMENT\n"
       << plain(
              "Every option can be given by an environment variable of its name: SALTUS_MODEL for --model, "
              "SALTUS_POINTS_SPACE for --points-space; that of register's --server is left out, since no address "
              "means a private daemon there. SALTUS_CONFIG names a configuration file, SALTUS_BIN the folder of "
              "saltusd.\n")
       << ".SH FILES\n"
       << plain(
              "A configuration file has a section for each command and the names of its options, without dashes in "
              "front:\n")
       << ".PP\n.nf\n"
       << plain("[register]\nmodel = \"sliding\"\npreset = \"accurate\"\n") << ".fi\n.PP\n"
       << plain("The command line goes before the environment, the environment before the file.\n")
       << ".SH EXIT STATUS\n"
          ".TP\n0\ndone\n.TP\n1\nthe job failed; the reason is on standard error\n.TP\n2\nusage\n"
          ".TP\n3\nthe server is not reachable\n.TP\n4\ncancelled\n";
  return page.str();
}

void add_manual_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("man", "Print the manual page, saltus(1)");
  command->footer("Example:\n  saltus man | man -l -");
  command->callback([&app, &exit_code] {
    std::cout << manual_page(commands_of(app));
    exit_code = Done;
  });
}

}  // namespace saltus::cli
