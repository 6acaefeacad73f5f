#include "client/cli/study/paper_study.h"

#include "client/cli/command.h"
#include "client/cli/statistics_json.h"
#include "client/cli/study/elementary_deformations.h"
#include "client/cli/study/kernel_figures.h"
#include "client/cli/study/liver_pairs.h"
#include "core/drawing/markup.h"
#include "core/evaluation/field_error.h"
#include "core/evaluation/jacobian.h"
#include "core/evaluation/transition_width.h"
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/phantom/interface_points.h"
#include "core/phantom/make_phantom.h"

#include <nlohmann/json.hpp>

#include <iostream>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;
using drawing::number;
using drawing::percentage;

// The paper's width of every kernel, pixels.
constexpr double paper_width = 9;
// How far off the interface the levels on its two sides are taken, pixels.
constexpr double reach_mm = 12, quick_reach_mm = 6;

const std::vector<std::string> paper_models{"gaussian", "wendland", "wendland1"};

/// Rectangle or wheel: images and all that is known about them.
struct PaperScene {
  std::string name, title;
  fs::path fixed, moving;
  Phantom<2> phantom;
  std::vector<InterfacePoint<2>> interface;
  double reach_mm = 0;
};

PaperScene prepare(const StudyRequest& request, PhantomKind kind, const std::string& title, const fs::path& own_fixed,
                   const fs::path& own_moving) {
  PhantomOptions options = default_phantom_options(kind);
  if (request.is_quick) {
    options.size = {72, 72, 1};
    options.radius_mm = 20;
    options.slip_mm = 6;
  }
  PaperScene scene{
      to_string(kind), title, {}, {}, make_phantom<2>(options), {}, request.is_quick ? quick_reach_mm : reach_mm};
  scene.interface = interface_points(*make_scene<2>(options), scene.phantom.fixed.grid);
  const fs::path folder = request.out / "scenes" / scene.name;
  fs::create_directories(folder);
  write_volume(folder / "fixed.mha", scene.phantom.fixed);
  write_volume(folder / "moving.mha", scene.phantom.moving);
  write_vector_volume(folder / "truth.mha", scene.phantom.displacement);
  write_labels(folder / "mask_valid.mha", scene.phantom.masks.valid);
  write_labels(folder / "mask_near.mha", scene.phantom.masks.near);
  scene.fixed = folder / "fixed.mha";
  scene.moving = folder / "moving.mha";
  const fs::path own = request.data / "paper2d";
  if (!request.is_quick && !request.data.empty() && fs::exists(own / own_fixed) && fs::exists(own / own_moving)) {
    scene.fixed = own / own_fixed;
    scene.moving = own / own_moving;
  }
  return scene;
}

Volume<2> both(const Volume<2>& a, const Volume<2>& b) {
  Volume<2> product = a;
  for (std::size_t i = 0; i < product.samples.size(); ++i) product.samples[i] *= b.samples[i];
  return product;
}

/// One line of the table: what is known of a displacement, found or true.
nlohmann::json measure(const PaperScene& scene, const std::string& name, const VectorVolume<2>& displacement) {
  const Phantom<2>& phantom = scene.phantom;
  const Volume<2> near = both(phantom.masks.valid, phantom.masks.near);
  const TransitionWidth width = transition_width(displacement, scene.interface, scene.reach_mm);
  nlohmann::json row{
      {"scene", scene.name},
      {"model", name},
      {"error_px", as_json(summarise(endpoint_errors<2>(displacement, phantom.displacement, phantom.masks.valid)))},
      {"error_near_px", as_json(summarise(endpoint_errors<2>(displacement, phantom.displacement, near)))},
      {"jump_px", width.jump_mm},
      {"share_folded", jacobian_statistics(jacobian_determinant(displacement)).share_not_positive}};
  if (width.resolved > 0) row["width_px"] = width.width_mm;
  return row;
}

StudyTable table_of(const nlohmann::json& rows) {
  StudyTable table;
  table.title = "What the paper does not give";
  table.explanation =
      "Mean endpoint error |u - true u| in pixels, over all pixels that both images show and within 3 pixels of the "
      "interface; the tangential jump that was found and the distance over which it goes from 10 to 90 % (0.8 is a "
      "jump "
      "between two neighbouring pixels); pixels with J <= 0 by central differences, which bridge the interface; CPU "
      "seconds of the registration, one machine for all.";
  table.head = {"scene", "model", "error", "error near", "jump", "width 10-90", "folds", "CPU s"};
  for (const nlohmann::json& row : rows)
    table.rows.push_back({row["scene"], row["model"], number(row["error_px"]["mean"].get<double>()),
                          number(row["error_near_px"]["mean"].get<double>()), number(row["jump_px"].get<double>()),
                          row.contains("width_px") ? number(row["width_px"].get<double>()) : "-",
                          percentage(row["share_folded"].get<double>()),
                          row.contains("cpu_seconds") ? number(row["cpu_seconds"].get<double>(), 2) : "-"});
  return table;
}

Pair make_pair(const StudyRequest& request, const std::string& name, const fs::path& fixed, const fs::path& moving,
               const std::string& model, const std::string& similarity) {
  Pair pair{name, {}};
  pair.job.fixed = fixed.string();
  pair.job.moving = moving.string();
  pair.job.model = model;
  pair.job.similarity = similarity;
  pair.job.preset = request.is_quick ? "fast" : "balanced";
  pair.job.format = "mha";
  pair.job.threads = request.threads;
  return pair;
}

std::string made_with(const StudyRequest& request, const std::string& similarity) {
  return " By saltus register --similarity " + similarity + " --preset " + (request.is_quick ? "fast" : "balanced") +
         " and --model as it stands above each column.";
}

/// The rectangle's and the wheel's figures and rows of the table.
void add_scene(const StudyRequest& request, const PaperScene& scene, Study& study, nlohmann::json& rows) {
  PairResults<2> results{
      scene.name, read_volume<2>(scene.fixed), read_volume<2>(scene.moving), scene.phantom.displacement, {}};
  rows.push_back(measure(scene, "before", VectorVolume<2>(results.fixed.grid)));
  for (const std::string& model : paper_models) {
    const fs::path folder = run_folder(request, scene.name + "-" + model);
    results.models.push_back(read_run<2>(folder, model));
    nlohmann::json row = measure(scene, model, results.models.back().displacement);
    row["cpu_seconds"] = cpu_seconds(folder);
    rows.push_back(std::move(row));
  }
  rows.push_back(measure(scene, "true field", scene.phantom.displacement));
  const auto plane = main_plane(results.truth.value());
  study.figures.push_back({scene.name, scene.title,
                           "Deformed templates, lengths of the displacements and deformed grids (of the fixed image, "
                           "over the template)." +
                               made_with(request, "ssd"),
                           deformation_sheet(results, plane)});
  study.figures.push_back({scene.name + "_difference", scene.title + ": differences",
                           "Template minus reference before registration, deformed template minus reference after.",
                           difference_sheet(results, plane)});
}

/// The lung's figures, of a liver pair.
void add_liver(const StudyRequest& request, const LiverPair& pair, Study& study, nlohmann::json& numbers) {
  PairResults<3> results{pair.name, read_volume<3>(pair.fixed), read_volume<3>(pair.moving), {}, {}};
  StudyTable table;
  table.title = "Liver: landmarks";
  table.explanation = "Mean error of the landmarks of " + pair.name +
                      " in the liver and outside, mm; voxels with J <= 0; CPU seconds of the registration.";
  table.head = {"model", "liver", "outside", "folds", "CPU s"};
  const LiverErrors before = liver_errors_before(pair);
  table.rows.push_back({"before", number(before.liver.mean), number(before.outside.mean), "-", "-"});
  nlohmann::json& rows = numbers["liver"];
  rows.push_back({{"pair", pair.name},
                  {"model", "before"},
                  {"liver_mm", as_json(before.liver)},
                  {"outside_mm", as_json(before.outside)}});
  for (const std::string& model : paper_models) {
    const fs::path folder = run_folder(request, "liver-" + model);
    results.models.push_back(read_run<3>(folder, model));
    const VectorVolume<3>& displacement = results.models.back().displacement;
    const LiverErrors after = liver_errors(pair, displacement);
    const double folded = jacobian_statistics(jacobian_determinant(displacement)).share_not_positive;
    const double seconds = cpu_seconds(folder);
    table.rows.push_back(
        {model, number(after.liver.mean), number(after.outside.mean), percentage(folded), number(seconds, 2)});
    rows.push_back({{"pair", pair.name},
                    {"model", model},
                    {"liver_mm", as_json(after.liver)},
                    {"outside_mm", as_json(after.outside)},
                    {"share_folded", folded},
                    {"cpu_seconds", seconds}});
  }
  study.tables.push_back(std::move(table));
  const auto plane = liver_plane(results.models.back().displacement);
  study.figures.push_back({"liver", "Breathing liver, in place of the paper's lung",
                           "Deformed templates with the displacement as red arrows, and its length, of " + pair.name +
                               ": one slice of a 3-D registration." + made_with(request, "lncc"),
                           field_sheet(results, plane)});
  study.figures.push_back({"liver_difference", "Breathing liver: differences",
                           "Template minus reference before registration, deformed template minus reference after.",
                           difference_sheet(results, plane)});
}

}  // namespace

int paper_study(const StudyRequest& request, bool as_json) {
  const std::vector<PaperScene> scenes{
      prepare(request, PhantomKind::Rectangle, "Sliding rectangle", "Toy_Reference_gra.png", "Toy_Template_gra.png"),
      prepare(request, PhantomKind::Wheel, "Turning wheel", "wheel_R7.png", "wheel_T7.png")};
  const std::vector<LiverPair> livers = find_liver_pairs(request.data);
  std::vector<Pair> pairs;
  for (const PaperScene& scene : scenes)
    for (const std::string& model : paper_models)
      pairs.push_back(make_pair(request, scene.name + "-" + model, scene.fixed, scene.moving, model, "ssd"));
  if (!livers.empty())
    for (const std::string& model : paper_models)
      pairs.push_back(make_pair(request, "liver-" + model, livers.front().fixed, livers.front().moving, model, "lncc"));
  if (const int code = run_all(request, pairs); code != Done) return code;

  Study study;
  study.title = "Sliding at first order: the paper's figures";
  study.introduction =
      "The figures of Bao, Lu, Ying and Sommer, \"Sliding at first order: higher-order momentum distributions for "
      "discontinuous image registration\", made again: its models are gaussian, wendland (order 0) and wendland1 "
      "(orders 0 and 1, the proposed one).";
  if (request.is_quick) study.notes.push_back("Made with --quick: smaller scenes and preset fast.");
  study.notes.push_back(scenes.front().fixed.extension() == ".png"
                            ? "Rectangle and wheel are the paper's own images."
                            : "Rectangle and wheel are made from the paper's description; --data with paper2d takes "
                              "the paper's own images.");
  nlohmann::json numbers{{"study", "paper"}, {"quick", request.is_quick}};
  nlohmann::json rows;
  study.figures.push_back(elementary_figure());
  study.figures.push_back(kernels_along_a_line(paper_width));
  study.figures.push_back(kernels_in_the_plane(paper_width));
  for (const PaperScene& scene : scenes) add_scene(request, scene, study, rows);
  study.tables.push_back(table_of(rows));
  numbers["scenes"] = std::move(rows);
  if (livers.empty()) {
    const std::string note = "The lung figures are left out: they are made of liver images, and " +
                             (request.data.empty() ? std::string("no folder is named; --data DIR has to hold liver_mri")
                                                   : "--data " + request.data.string() + " has no folder liver_mri") +
                             ".";
    std::cerr << "saltus: " << note << std::endl;
    study.notes.push_back(note);
  } else {
    add_liver(request, livers.front(), study, numbers);
  }
  return finish_study(request, study, numbers, as_json);
}

}  // namespace saltus::cli
