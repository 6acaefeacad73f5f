#include "server/launch/batch_script.h"

#include "server/launch/worker_environment.h"

#include <stdexcept>

namespace saltus::server {
namespace {

// A worker that goes on beyond the time it declares is ended by the daemon; the batch system comes later.
constexpr std::int64_t kSpareSeconds = 120;
constexpr std::int64_t kMebibyte = 1 << 20;
constexpr const char* kEndOfInput = "END_OF_INPUT";

std::int64_t whole(std::int64_t amount, std::int64_t unit) { return (amount + unit - 1) / unit; }

std::string script(const BatchSettings& settings, const BatchRequest& request) {
  // It would end what the shell hands to the worker, and begin commands.
  if (request.input.find(kEndOfInput) != std::string::npos || request.input.find('\0') != std::string::npos)
    throw std::logic_error("the input of a batch job cannot be put into its script");
  std::vector<std::string> words{settings.worker, "--server", settings.server_address};
  const auto add = [&words](const char* option, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {option, value});
  };
  add("--tls-ca", settings.tls.authority);
  add("--tls-cert", settings.tls.certificate);
  add("--tls-key", settings.tls.key);
  if (!settings.shared_data.empty()) add("--blobs", settings.shared_data + "/blobs/sha256");
  words.insert(words.end(), request.worker_arguments.begin(), request.worker_arguments.end());
  // Slurm gives a task cores of its own: threads may wait awake.
  std::string text = "#!/bin/sh\nexport PATH=/usr/local/bin:/usr/bin:/bin";
  for (const auto& [name, value] : worker_variables(request.threads, true)) text += " " + name + "=" + value;
  text += "\numask 077\nexec";
  for (const std::string& word : words) text += " " + shell_quoted(word);
  if (request.input.empty()) return text + " < /dev/null\n";
  return text + " << '" + kEndOfInput + "'\n" + request.input + "\n" + kEndOfInput + "\n";
}

}  // namespace

std::string shell_quoted(const std::string& text) {
  std::string quoted = "'";
  for (const char character : text) quoted += character == '\'' ? "'\\''" : std::string(1, character);
  return quoted + "'";
}

Command submission(const BatchSettings& settings, const BatchRequest& request) {
  Command command;
  command.arguments = {"sbatch", "--parsable",
                       // Another attempt with a token of its own is better than the same one twice.
                       "--no-requeue", "--job-name=" + request.name, "--ntasks=1",
                       "--cpus-per-task=" + std::to_string(request.threads),
                       // Nothing of the daemon's environment, and no login shell to make another one.
                       "--export=NIL",
                       // The daemon's may not be there.
                       "--chdir=/", "--output=" + request.output};
  if (request.memory_bytes > 0)
    command.arguments.push_back("--mem=" + std::to_string(whole(request.memory_bytes, kMebibyte)) + "M");
  if (request.wall_seconds > 0)
    command.arguments.push_back("--time=" + std::to_string(whole(request.wall_seconds + kSpareSeconds, 60)));
  if (request.array_size > 0) command.arguments.push_back("--array=1-" + std::to_string(request.array_size));
  command.arguments.insert(command.arguments.end(), settings.options.begin(), settings.options.end());
  command.input = script(settings, request);
  return command;
}

}  // namespace saltus::server
