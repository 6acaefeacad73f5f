#include "client/cli/server_command.h"

#include "client/cli/command.h"
#include "client/cli/connection.h"
#include "client/lib/admin_client.h"
#include "client/lib/registration_client.h"

#include <google/protobuf/util/json_util.h>
#include <CLI/CLI.hpp>

#include <chrono>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace saltus::cli {
namespace {

constexpr std::chrono::milliseconds kBetweenQuestions{500};

struct ServerOptions {
  ServerChoice server;
  bool as_json = false;
  bool resume = false;
  bool wait = false;
};

/// Every field with the protocol's name, so that what a newer daemon tells is shown too.
std::string json_text(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(message, &text, options);
  if (!status.ok()) throw std::runtime_error("the daemon's answer cannot be printed: " + status.ToString());
  return text;
}

/// One "name: value" a line; lists in one line.
std::string field_lines(const google::protobuf::Message& message) {
  std::ostringstream text;
  const auto* fields = message.GetDescriptor();
  const auto* reflection = message.GetReflection();
  for (int i = 0; i < fields->field_count(); ++i) {
    const auto* field = fields->field(i);
    if (field->message_type()) continue;
    text << field->name() << ':';
    if (field->is_repeated()) {
      for (int k = 0; k < reflection->FieldSize(message, field); ++k)
        if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_STRING)
          text << ' ' << reflection->GetRepeatedString(message, field, k);
    } else if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_STRING) {
      text << ' ' << reflection->GetString(message, field);
    } else if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_INT64) {
      text << ' ' << reflection->GetInt64(message, field);
    } else if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_INT32) {
      text << ' ' << reflection->GetInt32(message, field);
    } else if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_BOOL) {
      text << (reflection->GetBool(message, field) ? " yes" : " no");
    } else if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_DOUBLE) {
      text << ' ' << reflection->GetDouble(message, field);
    }
    text << '\n';
  }
  return text.str();
}

int print(const google::protobuf::Message& message, bool as_json) {
  std::cout << (as_json ? json_text(message) : field_lines(message)) << std::flush;
  return Done;
}

const char* describe(v1::FsckFinding::Kind kind) {
  switch (kind) {
    case v1::FsckFinding::KIND_CORRUPT:
      return "damaged, set aside; an upload of the same bytes heals it";
    case v1::FsckFinding::KIND_MISSING:
      return "missing; an upload of the same bytes heals it";
    case v1::FsckFinding::KIND_ORPHAN:
      return "known to nothing, harmless";
    default:
      return "of a kind that this program does not know";
  }
}

int fsck(const ServerOptions& options) {
  client::AdminClient client(call_settings(options.server));
  v1::FsckResponse all;
  const v1::FsckResponse last = client.fsck([&](const v1::FsckResponse& told) {
    for (const auto& finding : told.findings()) {
      if (options.as_json)
        *all.add_findings() = finding;
      else
        std::cout << finding.digest() << ": " << describe(finding.kind()) << '\n';
    }
    if (!options.as_json && !told.is_done()) std::cerr << told.bytes() << " bytes checked" << std::endl;
  });
  if (options.as_json) {
    v1::FsckResponse whole = last;
    *whole.mutable_findings() = all.findings();
    print(whole, true);
  } else {
    print(last, false);
  }
  return last.corrupt() + last.missing() > 0 ? JobFailed : Done;
}

/// Until no job runs; tells on standard error how many do whenever that has changed. Only asks: somebody else can take
/// the drain back meanwhile, or start the daemon again, after which nothing would end the wait. Throws then.
void wait_until_drained(const client::CallSettings& settings) {
  client::RegistrationClient client(settings);
  for (int told = -1;; client::wait_for(settings.stop, kBetweenQuestions)) {
    const v1::ServerInfo info = client.server_info();
    // Older daemons do not tell.
    if (info.has_is_draining() && !info.is_draining())
      throw std::runtime_error(
          "the server takes jobs again: somebody has resumed it or started it anew; drain it again");
    const int running = info.running_jobs();
    if (running == 0) return;
    if (running != std::exchange(told, running))
      std::cerr << running << (running == 1 ? " job still runs" : " jobs still run") << std::endl;
  }
}

int drain(const ServerOptions& options) {
  const client::CallSettings settings = call_settings(options.server);
  client::AdminClient client(settings);
  v1::DrainResponse response = client.drain(options.resume);
  if (options.wait) {
    wait_until_drained(settings);
    response.set_running_jobs(0);
  }
  return print(response, options.as_json);
}

template <class Act>
CLI::App* add_action(CLI::App& server, const char* name, const char* help, const char* example, int& exit_code,
                     Act act) {
  CLI::App* command = server.add_subcommand(name, help);
  auto options = std::make_shared<ServerOptions>();
  add_server_option(*command, options->server);
  command->add_flag("--json", options->as_json, "Print a JSON object");
  if (std::string(name) == "drain") {
    auto* resume = command->add_flag("--resume", options->resume, "Take jobs again");
    command->add_flag("--wait", options->wait, "Return when no job runs any more; tell how many do")->excludes(resume);
  }
  command->footer(std::string("Example:\n  saltus server ") + example);
  command->callback([options, act, &exit_code] { exit_code = act(*options); });
  return command;
}

}  // namespace

void add_server_command(CLI::App& app, int& exit_code) {
  CLI::App* server = app.add_subcommand("server", "Look after a server: info, drain, gc, fsck");
  server->require_subcommand(1);
  add_action(*server, "info", "Print what a server is and can do", "info --server unix:/run/saltusd/socket", exit_code,
             [](const ServerOptions& options) {
               client::RegistrationClient client(call_settings(options.server));
               return print(client.server_info(), options.as_json);
             });
  add_action(*server, "drain", "Take no new jobs and start none; what runs goes on", "drain --wait", exit_code, drain);
  add_action(*server, "gc", "Remove jobs, images and uploads whose time is over, now", "gc --json", exit_code,
             [](const ServerOptions& options) {
               client::AdminClient client(call_settings(options.server));
               return print(client.collect_garbage(), options.as_json);
             });
  add_action(*server, "fsck", "Check every stored file; exit code 1 when one is damaged or missing", "fsck", exit_code,
             fsck);
}

}  // namespace saltus::cli
