#include "client/cli/study/study_runs.h"

#include "client/cli/command.h"
#include "client/cli/report_summary.h"
#include "client/cli/transform_folder.h"
#include "core/image_io/read_image.h"
#include "core/image_io/read_transform.h"

#include <nlohmann/json.hpp>

#include <iostream>

namespace saltus::cli {

namespace fs = std::filesystem;

fs::path run_folder(const StudyRequest& request, const std::string& name) { return request.out / "runs" / name; }

int run_all(const StudyRequest& request, const std::vector<Pair>& pairs) {
  fs::create_directories(request.out);
  PairsRequest list;
  list.server = request.server;
  list.out = request.out / "runs";
  list.jobs = request.jobs;
  list.output = PairsOutput::Silent;
  return register_pairs(pairs, list);
}

template <int Dim>
ModelResult<Dim> read_run(const fs::path& folder, const std::string& name) {
  return {name, read_displacement<Dim>(displacement_file(folder, TransformDirection::Forward)),
          read_volume<Dim>(folder / "warped.mha")};
}

double cpu_seconds(const fs::path& folder) {
  return read_report(folder / "report.json").at("seconds").at("cpu").get<double>();
}

int finish_study(const StudyRequest& request, const Study& study, const nlohmann::json& numbers, bool as_json) {
  write_study(study, numbers, request.out);
  if (as_json)
    std::cout << numbers.dump(2) << std::endl;
  else
    std::cout << to_markdown(study.tables) << study.figures.size() << " figures, study.html and study.json are in "
              << request.out.string() << std::endl;
  return Done;
}

template ModelResult<2> read_run(const fs::path&, const std::string&);
template ModelResult<3> read_run(const fs::path&, const std::string&);

}  // namespace saltus::cli
