#pragma once

#include "client/cli/register_pairs.h"
#include "client/cli/study/pair_figures.h"
#include "client/cli/study/study_page.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace saltus::cli {

/// What both studies are asked.
struct StudyRequest {
  std::filesystem::path out;
  std::filesystem::path data;                ///< a folder with paper2d and liver_mri; empty: none
  bool is_quick = false;                     ///< small scenes and little work: to see that all is well
  std::vector<std::string> models, presets;  ///< of the liver study
  int threads = 1;                           ///< of a run: CPU seconds of several threads are not comparable
  int jobs = 0;                              ///< runs at the same time, as in PairsRequest
  ServerChoice server;
};

/// The folder of a run below a study's.
std::filesystem::path run_folder(const StudyRequest& request, const std::string& name);

/// Runs what is not there yet, on one server or private daemon. The exit code of the list.
int run_all(const StudyRequest& request, const std::vector<Pair>& pairs);

/// What a run left in its folder.
template <int Dim>
ModelResult<Dim> read_run(const std::filesystem::path& folder, const std::string& name);

/// CPU seconds of the registration, from the run's report.
double cpu_seconds(const std::filesystem::path& folder);

/// Writes the study below `request.out` and prints its tables, or `numbers`. The exit code.
int finish_study(const StudyRequest& request, const Study& study, const nlohmann::json& numbers, bool as_json);

}  // namespace saltus::cli
