#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "core/support/fingerprint.h"
#include "tests/benchmark/peers/methods.h"

namespace saltus::benchmark {
namespace {

class Saltus final : public Method {
 public:
  Saltus(std::filesystem::path program, std::string model, std::string preset)
      : program_(std::move(program)), model_(std::move(model)), preset_(std::move(preset)) {
    // A new build is another program.
    Fingerprint build;
    for (const char* name : {"saltus", "saltusd", "saltus-worker"}) {
      const std::filesystem::path path = program_.parent_path() / name;
      std::ifstream file(path, std::ios::binary);
      if (!file) throw std::runtime_error(path.string() + " is missing; build it or name another --program");
      const std::string bytes{std::istreambuf_iterator<char>(file), {}};
      build.add(std::string_view(bytes));
    }
    build_ = build.value();
  }

  std::string family() const override { return model_ == "auto" ? "saltus" : "saltus " + model_; }
  std::string choice() const override { return preset_; }
  std::string setting(const PeerPair& pair, int threads) const override {
    std::string text = "build " + std::to_string(build_);
    for (const std::string& word : options(pair, threads)) text += ' ' + word;
    return text;
  }

  MethodRun run(const PeerPair& pair, int threads, const std::filesystem::path& folder) const override {
    std::vector<std::string> command{program_,   "register",  "--fixed", pair.fixed,
                                     "--moving", pair.moving, "--out",   folder / "result"};
    for (const std::string& word : options(pair, threads)) command.push_back(word);
    MethodRun result;
    result.cost = run_measured(command, {{"OMP_WAIT_POLICY", "passive"}}, folder / "output.txt");
    if (result.cost.exit_code != 0)
      throw std::runtime_error(program_.string() + " ended with exit code " + std::to_string(result.cost.exit_code) +
                               ", see " + (folder / "output.txt").string());
    result.displacement = folder / "result" / "displacement.mha";
    result.warped = folder / "result" / "warped.mha";
    std::ifstream report(folder / "result" / "report.json");
    result.registration_cpu = nlohmann::json::parse(report).at("seconds").at("cpu").get<double>();
    return result;
  }

 private:
  std::vector<std::string> options(const PeerPair& pair, int threads) const {
    return {"--model",      model_,
            "--preset",     preset_,
            "--similarity", to_string(pair.similarity),
            "--threads",    std::to_string(threads),
            "--format",     "mha"};
  }

  std::filesystem::path program_;
  std::string model_, preset_;
  std::uint64_t build_ = 0;
};

}  // namespace

std::unique_ptr<Method> make_saltus(const std::filesystem::path& program, const std::string& model,
                                    const std::string& preset) {
  return std::make_unique<Saltus>(program, model, preset);
}

}  // namespace saltus::benchmark
