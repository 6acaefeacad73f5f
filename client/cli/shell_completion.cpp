#include "client/cli/shell_completion.h"

#include "client/cli/command.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <sstream>

namespace saltus::cli {
namespace {

std::string joined(const std::vector<std::string>& words, const std::string& between = " ") {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

/// First words of the commands, in order, and what follows each.
std::vector<std::pair<std::string, std::vector<std::string>>> first_words(const std::vector<CommandInfo>& commands) {
  std::vector<std::pair<std::string, std::vector<std::string>>> words;
  for (const CommandInfo& command : commands) {
    if (words.empty() || words.back().first != command.path.front()) words.push_back({command.path.front(), {}});
    if (command.path.size() > 1) words.back().second.push_back(command.path[1]);
  }
  return words;
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

/// What a first word stands for.
std::string description_of(const std::string& word, const std::vector<CommandInfo>& commands) {
  for (const CommandInfo& command : commands)
    if (command.path.front() == word) return command.path.size() > 1 ? command.group : command.description;
  return "";
}

/// Values of the command's first argument without a dash, when they are known.
std::vector<std::string> positional_choices(const CommandInfo& command) {
  for (const OptionInfo& option : command.options)
    if (option.is_positional) return option.choices;
  return {};
}

/// Within single quotes of a POSIX shell.
std::string single_quoted(const std::string& text) {
  std::string safe = "'";
  for (char letter : text) safe += letter == '\'' ? std::string("'\\''") : std::string(1, letter);
  return safe + "'";
}

/// Within single quotes of fish.
std::string fish_quoted(const std::string& text) {
  std::string safe = "'";
  for (char letter : text) {
    if (letter == '\'' || letter == '\\') safe += '\\';
    safe += letter;
  }
  return safe + "'";
}

}  // namespace

std::string bash_completion(const std::vector<CommandInfo>& commands) {
  std::ostringstream script;
  std::map<std::string, std::string> choices;
  std::set<std::string> files, others;
  for (const CommandInfo& command : commands)
    for (const OptionInfo& option : command.options)
      for (const std::string& name : option.names) {
        if (option.is_positional || option.value.empty()) continue;
        if (!option.choices.empty())
          choices[name] = joined(option.choices);
        else
          (option.takes_file ? files : others).insert(name);
      }
  script << "# Completion of saltus for bash: source this file, or put it into /etc/bash_completion.d\n"
            "_saltus() {\n"
            "  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} words=\n"
            "  COMPREPLY=()\n"
            "  case $previous in\n";
  for (const auto& [name, values] : choices)
    script << "    " << name << ") COMPREPLY=($(compgen -W '" << values << "' -- \"$current\")); return ;;\n";
  if (!files.empty())
    script << "    " << joined({files.begin(), files.end()}, "|")
           << ") compopt -o filenames; COMPREPLY=($(compgen -f -- \"$current\")); return ;;\n";
  if (!others.empty()) script << "    " << joined({others.begin(), others.end()}, "|") << ") return ;;\n";
  script << "  esac\n  if ((COMP_CWORD == 1)); then\n    words='";
  for (const auto& [word, below] : first_words(commands)) script << word << ' ';
  script << "--help --version --config'\n  else\n    case \"${COMP_WORDS[1]} ${COMP_WORDS[2]} \" in\n";
  for (const CommandInfo& command : commands) {
    script << "      '" << joined(command.path) << " '*) words='";
    script << joined(positional_choices(command)) << ' ';
    for (const OptionInfo& option : command.options)
      if (!option.is_positional) script << joined(option.names) << ' ';
    script << "' ;;\n";
  }
  for (const auto& [word, below] : first_words(commands))
    if (!below.empty()) script << "      '" << word << "'*) words='" << joined(below) << "' ;;\n";
  script << "    esac\n  fi\n"
            "  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
            "}\n"
            "complete -F _saltus saltus\n";
  return script.str();
}

std::string zsh_completion(const std::vector<CommandInfo>& commands) {
  std::ostringstream script;
  // Brackets and colons mean something to _arguments.
  const auto plain = [](const std::string& text) {
    std::string safe;
    for (char letter : first_line(text)) {
      if (letter == '[' || letter == ']' || letter == ':' || letter == '\\') safe += '\\';
      safe += letter;
    }
    return safe;
  };
  script << "#compdef saltus\n# Completion of saltus for zsh: put it as _saltus into a folder of $fpath.\n_saltus() {\n"
            "  local -a commands\n  commands=(\n";
  for (const auto& [word, below] : first_words(commands)) {
    script << "    " << single_quoted(word + ":" + plain(description_of(word, commands))) << '\n';
  }
  script << "  )\n  if ((CURRENT == 2)); then _describe command commands; return; fi\n"
            "  local command=$words[2]\n";
  for (const auto& [word, below] : first_words(commands))
    if (!below.empty())
      script << "  if [[ $command == " << word << " ]]; then\n    if ((CURRENT == 3)); then compadd " << joined(below)
             << "; return; fi\n    command=\"$command $words[3]\"\n  fi\n";
  script << "  case $command in\n";
  for (const CommandInfo& command : commands) {
    script << "    " << single_quoted(joined(command.path)) << ") _arguments \\\n";
    for (const OptionInfo& option : command.options) {
      if (option.is_positional) continue;
      for (const std::string& name : option.names) {
        std::string text = "*" + name + "[" + plain(option.description) + "]";
        if (!option.choices.empty())
          text += ":" + plain(option.value) + ":(" + joined(option.choices) + ")";
        else if (!option.value.empty())
          text += ":" + plain(option.value) + ":" + (option.takes_file ? "_files" : " ");
        script << "      " << single_quoted(text) << " \\\n";
      }
    }
    if (const auto values = positional_choices(command); !values.empty())
      script << "      " << single_quoted(std::to_string(command.path.size() + 1) + ": :(" + joined(values) + ")")
             << " \\\n";
    script << "      '*: :_files' ;;\n";
  }
  script << "  esac\n}\n_saltus \"$@\"\n";
  return script.str();
}

std::string fish_completion(const std::vector<CommandInfo>& commands) {
  std::ostringstream script;
  script << "# Completion of saltus for fish: put it into ~/.config/fish/completions/saltus.fish\n"
            "complete -c saltus -f\n";
  for (const auto& [word, below] : first_words(commands)) {
    script << "complete -c saltus -n __fish_use_subcommand -a " << word << " -d "
           << fish_quoted(description_of(word, commands)) << '\n';
    if (!below.empty())
      script << "complete -c saltus -n '__fish_seen_subcommand_from " << word
             << "; and not __fish_seen_subcommand_from " << joined(below) << "' -a '" << joined(below) << "'\n";
  }
  for (const CommandInfo& command : commands) {
    std::vector<std::string> seen;
    for (const std::string& word : command.path) seen.push_back("__fish_seen_subcommand_from " + word);
    if (const auto values = positional_choices(command); !values.empty())
      script << "complete -c saltus -n '" << joined(seen, "; and ") << "; and not __fish_seen_subcommand_from "
             << joined(values) << "' -a '" << joined(values) << "'\n";
    for (const OptionInfo& option : command.options) {
      if (option.is_positional) continue;
      for (const std::string& name : option.names) {
        script << "complete -c saltus -n '" << joined(seen, "; and ") << "' "
               << (name.starts_with("--") ? "-l " + name.substr(2) : "-s " + name.substr(1));
        if (!option.choices.empty())
          script << " -x -a '" << joined(option.choices) << "'";
        else if (option.takes_file)
          script << " -r -F";
        else if (!option.value.empty())
          script << " -x";
        script << " -d " << fish_quoted(first_line(option.description)) << '\n';
      }
    }
  }
  return script.str();
}

void add_completion_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("completion", "Print a script that completes saltus's commands and options");
  auto shell = std::make_shared<std::string>();
  command->add_option("shell", *shell, "bash, zsh or fish")->required();
  command->footer(
      "Examples:\n"
      "  source <(saltus completion bash)\n"
      "  saltus completion fish > ~/.config/fish/completions/saltus.fish");
  command->callback([&app, shell, &exit_code] {
    const auto commands = commands_of(app);
    if (*shell == "bash")
      std::cout << bash_completion(commands);
    else if (*shell == "zsh")
      std::cout << zsh_completion(commands);
    else if (*shell == "fish")
      std::cout << fish_completion(commands);
    else
      throw InvalidInput("completion is for " + *shell + "; it must be bash, zsh or fish");
    exit_code = Done;
  });
}

}  // namespace saltus::cli
