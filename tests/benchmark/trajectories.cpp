#include "tests/benchmark/trajectories.h"

#include <Eigen/LU>
#include <cmath>

#include "core/support/stopwatch.h"
#include "tests/unit/core/flow/discontinuous/analytic_velocities.h"

namespace saltus::benchmark {
namespace {

using testing::AnalyticVelocity;
using testing::moving_plane;

struct Expectation {
  TrajectoryEnd ending = TrajectoryEnd::Complete;
  Vector<2> position = Vector<2>::Zero();  ///< of a complete one
  double determinant = 1;                  ///< of its fundamental matrix
};

Row followed(const std::string& name, const PiecewiseVelocity<2>& velocity, const Vector<2>& start, double until,
             const Expectation& expected) {
  Row row;
  row.name = name;
  const Stopwatch watch;
  const Trajectory<2> found = follow<2>(velocity, start, 0, until);
  row.add("cpu_seconds", watch.cpu_seconds());
  row.outcome = to_string(found.ending);
  row.add("events", static_cast<double>(found.events.size()));
  if (found.ending != expected.ending) row.complaints.push_back("it is to end as: " + to_string(expected.ending));
  if (!found.position.allFinite() || !found.fundamental.allFinite()) row.complaints.push_back("a value is not finite");
  if (expected.ending != TrajectoryEnd::Complete) return row;
  const double error = (found.position - expected.position).norm(),
               determinant_error = std::abs(found.fundamental.determinant() - expected.determinant);
  row.add("error_mm", error);
  row.add("determinant_error", determinant_error);
  if (!(error < 1e-6 && determinant_error < 1e-6)) row.complaints.push_back("far from the closed form");
  return row;
}

/// A constant velocity for each layer between the planes y = 1, 2, ..., `layers` - 1.
AnalyticVelocity<2> layers(std::vector<Vector<2>> velocities) {
  std::vector<AnalyticVelocity<2>::Surface> planes;
  for (std::size_t k = 1; k < velocities.size(); ++k)
    planes.push_back(moving_plane<2>({0, 1}, static_cast<double>(k), 0));
  return {planes, [velocities](double, const Vector<2>&, const Sides& sides) {
            std::size_t layer = 0;
            while (layer < sides.size() && sides[layer] > 0) ++layer;
            return VelocityJet<2>{velocities[layer], Matrix<2>::Zero()};
          }};
}

}  // namespace

std::vector<Row> trajectory_rows(const std::string& only) {
  std::vector<Row> rows;
  const auto add = [&](const std::string& name, const PiecewiseVelocity<2>& velocity, const Vector<2>& start,
                       double until, const Expectation& expected) {
    if (name.find(only) != std::string::npos) rows.push_back(followed(name, velocity, start, until, expected));
  };
  // From y = 0: 1 through the first layer, 1/2 through the second, 1/4 through the third, 1 in the last. The map is
  // squeezed by the ratio of the fluxes, after over before.
  add("trajectory across 3 surfaces", layers({{1, 1}, {-2, 2}, {3, 4}, {0.5, 8}}), {0, 0}, 2.75,
      {TrajectoryEnd::Complete, {1 - 1 + 0.75 + 0.5, 3 + 8}, 8});
  // A slip: only the tangential part jumps, nothing opens or closes.
  add("trajectory across a slip", layers({{3, 0.5}, {-3, 0.5}}), {0, 0.5}, 2, {TrajectoryEnd::Complete, {0, 1.5}, 1});
  // Both sides go into the plane y = 1 and weigh the same: half of each from t = 1/2 on; a line becomes a point.
  add("trajectory that slides along", layers({{1, 1}, {2, -1}}), {0, 0.5}, 2,
      {TrajectoryEnd::Complete, {0.5 + 1.5 * 1.5, 1}, 0});
  add("trajectory that grazes", layers({{1, 1e-5}, {-1, 1e-5}}), {0, 1 - 5e-6}, 1, {TrajectoryEnd::Grazing, {}, 1});
  add("trajectory from an escaping surface", layers({{1, -1}, {1, 1}}), {0, 1}, 1, {TrajectoryEnd::Escaping, {}, 1});
  return rows;
}

}  // namespace saltus::benchmark
