#include "client/cli/result_files.h"

#include "core/support/errors.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <fstream>
#include <initializer_list>
#include <regex>
#include <set>
#include <system_error>

namespace saltus::cli {
namespace {

/// "displacement" for displacement.nii.gz; "" for what is no image in a format that results are written in.
std::string image_stem(const std::string& name) {
  for (const char* suffix : {".mha", ".nii.gz", ".nrrd"})
    if (name.ends_with(suffix)) return name.substr(0, name.size() - std::string(suffix).size());
  return "";
}

bool is_momentum(const std::string& stem) {
  static const std::regex pattern("momentum_[1-9][0-9]*_order(0|1_[xyz]|1_oriented)");
  return std::regex_match(stem, pattern);
}

bool is_one_of(const std::string& word, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

}  // namespace

bool is_marked_done(const std::filesystem::path& folder) {
  std::ifstream in(folder / done_file);
  const nlohmann::json mark = nlohmann::json::parse(in, nullptr, /*allow_exceptions=*/false);
  return mark.is_object() && mark.size() == 1 && mark.contains("request") && mark.at("request").is_string();
}

void refuse_input_among_results(const std::string& option, const std::filesystem::path& input,
                                const std::filesystem::path& out) {
  std::error_code unknown;  // what is not there cannot be replaced
  const std::filesystem::path file = std::filesystem::canonical(input, unknown);
  if (unknown || !std::filesystem::equivalent(file.parent_path(), out, unknown) || unknown) return;
  const std::string stem = image_stem(file.filename().string());
  if (!is_momentum(stem) && !is_one_of(stem, {"displacement", "inverse_displacement", "warped", "jacobian"})) return;
  throw InvalidInput(option + " is " + input.string() +
                     ", which lies in --out under the name of a result, and the new one "
                     "would replace it; name another --out, or move the file");
}

bool holds_result(const std::filesystem::path& folder) {
  std::ifstream in(folder / "report.json");
  const nlohmann::json report = nlohmann::json::parse(in, nullptr, /*allow_exceptions=*/false);
  if (!report.is_object() || !report.contains("program")) return false;
  const nlohmann::json& program = report.at("program");
  return program.is_string() && program.get<std::string>().starts_with("saltus ");
}

std::vector<std::filesystem::path> outdated_files(const std::filesystem::path& folder,
                                                  const std::vector<std::string>& names) {
  const std::set<std::string> present(names.begin(), names.end());
  std::set<std::string> stems;
  for (const std::string& name : names) stems.insert(image_stem(name));
  std::vector<std::filesystem::path> outdated;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string(), stem = image_stem(name);
    if (stem.empty() || present.contains(name) || entry.is_symlink() || !entry.is_regular_file()) continue;
    // The number of scales, and so of momenta, differs from one registration to the next.
    if (stems.contains(stem) || (stems.contains("displacement") && is_momentum(stem))) outdated.push_back(entry.path());
  }
  std::sort(outdated.begin(), outdated.end());
  return outdated;
}

}  // namespace saltus::cli
