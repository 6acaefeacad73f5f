#pragma once

#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "tests/support/blob_pair.h"
#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace saltus::testing_support {

inline const std::string programs = SALTUS_PROGRAMS;
constexpr double shift_mm = 3;

/// A finished command.
struct Outcome {
  int exit_code;
  std::string out, err;
};

/// The programs as a user has them: images in a folder, temporary files where they can be counted.
class EndToEnd : public testing::Test {
 protected:
  void SetUp() override {
    write_volume(folder / "fixed.mha", blob_scene(48, 0));
    write_volume(folder / "moving.mha", blob_scene(48, shift_mm));
    std::filesystem::create_directory(folder / "tmp");
  }

  std::map<std::string, std::string> environment() const { return {{"TMPDIR", (folder / "tmp").string()}}; }

  ChildProcess start(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), programs + "/saltus");
    return ChildProcess(arguments, environment());
  }
  Outcome run(const std::vector<std::string>& arguments) const {
    ChildProcess child = start(arguments);
    const int exit_code = child.wait();
    return {exit_code, child.out(), child.err()};
  }
  /// `command` with a pair to register. It takes a moment, or is made to take what the test needs.
  std::vector<std::string> job(std::vector<std::string> command, const std::vector<std::string>& more = {}) const {
    command.insert(command.end(), {"--fixed", folder / "fixed.mha", "--moving", folder / "moving.mha", "--format",
                                   "mha", "--preset", "fast", "--threads", "1"});
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
  static std::vector<std::string> of_a_moment() {
    return {"--model", "gaussian", "--similarity", "ssd", "--set", "regularisation=0.0001"};
  }
  /// What it does is watched by programs that have to begin first: it takes longer than that on a fast machine as well.
  static std::vector<std::string> of_some_seconds() {
    return {"--model", "sliding",       "--set", "coarsening=0",           "--set", "tolerance=0",
            "--set",   "time_steps=64", "--set", "optimality_tolerance=0", "--set", "max_iterations=120",
            "--set",   "map_steps=8",   "--set", "reweighted_rounds=4"};
  }
  /// In many rounds: one may end as soon as nothing can be gained in single precision.
  static std::vector<std::string> of_minutes() {
    return {"--model",      "sliding",
            "--similarity", "ssd",
            "--set",        "coarsening=0",
            "--set",        "tolerance=0",
            "--set",        "time_steps=64",
            "--set",        "levels=1",
            "--set",        "optimality_tolerance=0",
            "--set",        "width_voxels=64",
            "--set",        "max_iterations=10000",
            "--set",        "map_steps=16",
            "--set",        "reweighted_rounds=10",
            "--set",        "sparsity_path=12"};
  }

  // Oracle: the scene was moved by (shift, 0) mm.
  void expect_shift(const std::filesystem::path& file) const {
    const auto field = read_vector_volume<2>(file);
    const std::size_t middle = 48 * 24 + 24;
    EXPECT_NEAR(field.component(0)[middle], shift_mm, 0.2 * shift_mm);
    EXPECT_NEAR(field.component(1)[middle], 0, 0.2 * shift_mm);
  }

  testing_support::TemporaryFolder folder;
};

/// A daemon of the test's own, which may be killed and started again on the same data.
class ServerTest : public EndToEnd {
 protected:
  void SetUp() override {
    EndToEnd::SetUp();
    start_daemon();
  }

  void start_daemon() {
    std::vector<std::string> command{programs + "/saltusd", "--data", folder / "data", "--listen", address};
    command.insert(command.end(), daemon_options.begin(), daemon_options.end());
    auto variables = environment();
    variables.insert(daemon_environment.begin(), daemon_environment.end());
    daemon.emplace(command, variables);
    daemon->wait_for_output("listening on");
  }
  /// `arguments` and the daemon's address.
  std::vector<std::string> here(std::vector<std::string> arguments) const {
    arguments.insert(arguments.end(), {"--server", address});
    return arguments;
  }
  std::string submit(const std::vector<std::string>& more = of_a_moment()) const {
    const Outcome outcome = run(here(job({"submit"}, more)));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.out.substr(0, outcome.out.find('\n'));
  }
  nlohmann::json get(const std::string& id) const {
    return nlohmann::json::parse(run(here({"get", id, "--json"})).out);
  }
  /// Digests of what the solver has found; the other files have times in them.
  std::map<std::string, std::string> results(const std::string& id) const {
    std::map<std::string, std::string> digests;
    const nlohmann::json job = get(id);
    for (const nlohmann::json& artifact : job["artifacts"])
      if (artifact["name"].get<std::string>().ends_with(".mha")) digests[artifact["name"]] = artifact["digest"];
    EXPECT_TRUE(digests.contains("displacement.mha") && digests.contains("momentum_1_order0.mha"));
    return digests;
  }

  const std::string address = "unix:" + (folder / "socket").string();
  std::vector<std::string> daemon_options;
  std::map<std::string, std::string> daemon_environment;  ///< which its workers have too
  std::optional<ChildProcess> daemon;
};

}  // namespace saltus::testing_support
