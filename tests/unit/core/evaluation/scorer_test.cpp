#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "core/evaluation/field_error.h"
#include "core/evaluation/jacobian.h"
#include "core/image_io/points_io.h"
#include "core/image_io/write_image.h"
#include "tests/unit/core/evaluation/fields.h"

namespace saltus {
namespace {

namespace fs = std::filesystem;

std::string output_of(const std::string& command) {
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return "";
  std::string output;
  char buffer[4096];
  while (std::size_t count = std::fread(buffer, 1, sizeof buffer, pipe)) output.append(buffer, count);
  pclose(pipe);
  return output;
}

void expect_equal(const Statistics& ours, const nlohmann::json& theirs) {
  EXPECT_EQ(ours.n, theirs.at("n").get<std::size_t>());
  EXPECT_NEAR(ours.mean, theirs.at("mean").get<double>(), 1e-9);
  EXPECT_NEAR(ours.sd, theirs.at("sd").get<double>(), 1e-9);
  EXPECT_NEAR(ours.median, theirs.at("median").get<double>(), 1e-9);
  EXPECT_NEAR(ours.p90, theirs.at("p90").get<double>(), 1e-9);
  EXPECT_NEAR(ours.max, theirs.at("max").get<double>(), 1e-9);
}

/// Oracle: an independent scorer written with numpy, on a rough field, an oblique grid and points in and outside it.
template <int Dim>
void expect_scorer_agrees() {
  const fs::path scorer = SALTUS_SCORER;
  if (!fs::exists(scorer)) GTEST_SKIP() << scorer << " is not here";
  if (std::system("/usr/bin/python3 -c 'import numpy' 2>/dev/null") != 0) GTEST_SKIP() << "python3-numpy is missing";
  const fs::path folder =
      fs::path(testing::TempDir()) / ("saltus_scorer_" + std::to_string(Dim) + "_" + std::to_string(getpid()));
  fs::create_directories(folder);

  const ImageGrid<Dim> grid = oblique_grid<Dim>();
  const auto field = make_field(grid, [](const Vector<Dim>& x) -> Vector<Dim> {
    return (x * 3.1).array().sin() + 0.3 * (x.reverse() * 1.7).array().cos();
  });
  const auto truth = make_field(grid, [](const Vector<Dim>& x) -> Vector<Dim> { return 0.1 * x; });
  const auto mask = make_image(grid, [](const Vector<Dim>& x) { return x[0] > -18 ? 1 : 0; });
  std::vector<Vector<Dim>> fixed, moving;
  for (int i = 0; i < 37; ++i) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = -2 + std::fmod(i * (3.7 + axis), grid.size[axis] + 4.0);
    fixed.push_back(grid.to_world(index));
    moving.push_back(fixed.back() + Vector<Dim>::Constant(0.05 * i));
  }
  write_vector_volume(folder / "field.mha", field);
  write_vector_volume(folder / "truth.mha", truth);
  write_labels(folder / "mask.mha", mask);
  write_points(folder / "fixed.csv", fixed);
  write_points(folder / "moving.csv", moving);

  const std::string in = folder.string() + "/";
  const std::string answer = output_of("/usr/bin/python3 " + scorer.string() + " " + in + "field.mha --fixed-points " +
                                       in + "fixed.csv --moving-points " + in + "moving.csv --truth " + in +
                                       "truth.mha --mask " + in + "mask.mha --jacobian");
  fs::remove_all(folder);
  const nlohmann::json theirs = nlohmann::json::parse(answer, nullptr, false);
  ASSERT_FALSE(theirs.is_discarded()) << answer;

  expect_equal(summarise(landmark_errors(field, fixed, moving)), theirs.at("tre_mm"));
  expect_equal(summarise(landmark_distances<Dim>(fixed, moving)), theirs.at("tre_before_mm"));
  expect_equal(summarise(endpoint_errors<Dim>(field, truth, mask)), theirs.at("epe_mm"));
  const JacobianStatistics ours = jacobian_statistics(jacobian_determinant(field));
  // The determinants are kept in single precision.
  EXPECT_NEAR(ours.min, theirs.at("jacobian").at("min").get<double>(), 1e-5);
  EXPECT_NEAR(ours.max, theirs.at("jacobian").at("max").get<double>(), 1e-5);
  EXPECT_DOUBLE_EQ(ours.share_not_positive, theirs.at("jacobian").at("share_not_positive").get<double>());
  EXPECT_GT(ours.share_not_positive, 0.01);
}

TEST(Evaluation, AgreesWithTheIndependentScorer2D) { expect_scorer_agrees<2>(); }
TEST(Evaluation, AgreesWithTheIndependentScorer3D) { expect_scorer_agrees<3>(); }

}  // namespace
}  // namespace saltus
