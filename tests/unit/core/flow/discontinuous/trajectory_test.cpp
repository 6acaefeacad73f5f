#include "core/flow/discontinuous/trajectory.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>

#include "core/support/errors.h"
#include "tests/unit/core/flow/discontinuous/analytic_velocities.h"

namespace saltus {
namespace {

using namespace testing;

template <int Dim>
AnalyticVelocity<Dim> constant_sides(Vector<Dim> n, double position, double speed, Vector<Dim> minus, Vector<Dim> plus,
                                     double scale = 1) {
  return AnalyticVelocity<Dim>({moving_plane<Dim>(n, position, speed, scale)},
                               [=](double, const Vector<Dim>&, const Sides& sides) {
                                 return VelocityJet<Dim>{sides[0] > 0 ? plus : minus, Matrix<Dim>::Zero()};
                               });
}

// Closed form: constant velocities, a plane that moves, H no distance. Crossing at t = (p - n.x0)/(n.v- - c).
TEST(Trajectory, CrossesAMovingPlaneAtTheTimeThatTheClosedFormGives) {
  const Vector<3> n = Vector<3>(1, 2, 2) / 3, minus(1, 0.5, 0.2), plus(0.7, -0.4, 0.9), start(0.1, 0, 0);
  const double c = 0.1, p = 0.3;
  const auto velocity = constant_sides<3>(n, p, c, minus, plus, 5.0);
  const auto found = follow<3>(velocity, start, 0, 1);
  const double hit = (p - n.dot(start)) / (n.dot(minus) - c);
  ASSERT_EQ(found.ending, TrajectoryEnd::Complete);
  ASSERT_EQ(found.events.size(), 1u);
  EXPECT_EQ(found.events[0].kind, EventKind::Crossing);
  EXPECT_NEAR(found.events[0].time, hit, 1e-11);
  EXPECT_LT((found.position - (start + hit * minus + (1 - hit) * plus)).norm(), 1e-11);
  const Matrix<3> S = Matrix<3>::Identity() + (plus - minus) * n.transpose() / (n.dot(minus) - c);
  EXPECT_LT((found.fundamental - S).norm(), 1e-11);
}

TEST(Trajectory, GoesBackToWhereItCameFrom) {
  const AnalyticVelocity<2> velocity({growing_ball<2>(1, 0.2)}, [](double t, const Vector<2>& x, const Sides& sides) {
    return wave<2>(sides[0] > 0 ? 1 : 2, t, x) + affine<2>(Vector<2>(1.5, 0.2), Matrix<2>::Zero(), x);
  });
  const Vector<2> start(-1.6, 0.2);
  const auto there = follow<2>(velocity, start, 0, 3);
  ASSERT_EQ(there.ending, TrajectoryEnd::Complete);
  ASSERT_EQ(there.count(EventKind::Crossing), 2);
  const auto back = follow<2>(ReversedVelocity<2>(velocity), there.position, -3, 0);
  ASSERT_EQ(back.ending, TrajectoryEnd::Complete);
  EXPECT_LT((back.position - start).norm(), 1e-7);
  EXPECT_LT((back.fundamental * there.fundamental - Matrix<2>::Identity()).norm(), 1e-6);
}

// A rotation about the origin with another angular speed inside the unit circle: no crossing on circles, and for an
// off-centre circle of speed the times are those of the angles.
TEST(Trajectory, RotatesAcrossAPlaneWithTheAngleOfTheClosedForm) {
  const double below = 2.0, above = 5.0;
  const AnalyticVelocity<2> velocity({moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                                     [=](double, const Vector<2>& x, const Sides& sides) {
                                       Matrix<2> turn;
                                       const double w = sides[0] > 0 ? above : below;
                                       turn << 0, -w, w, 0;
                                       return affine<2>(Vector<2>::Zero(), turn, x);
                                     });
  // From angle -0.4: below until 0.2, above for pi/5, below until t = 1.
  const auto found = follow<2>(velocity, Vector<2>(std::cos(-0.4), std::sin(-0.4)), 0, 1);
  ASSERT_EQ(found.count(EventKind::Crossing), 2);
  EXPECT_NEAR(found.events[0].time, 0.2, 1e-9);
  EXPECT_NEAR(found.events[1].time, 0.2 + M_PI / 5, 1e-9);
  const double angle = M_PI + below * (1 - 0.2 - M_PI / 5);
  EXPECT_LT((found.position - Vector<2>(std::cos(angle), std::sin(angle))).norm(), 1e-8);
  // The fluxes at the two crossings are w_above/w_below and its inverse.
  EXPECT_NEAR(found.events[0].saltation.determinant(), above / below, 1e-8);
  EXPECT_NEAR(found.fundamental.determinant(), 1.0, 1e-7);
}

TEST(Trajectory, CrossesTheSameSurfaceAgainAndAgain) {
  const AnalyticVelocity<2> velocity({moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                                     [](double, const Vector<2>& x, const Sides& sides) {
                                       Matrix<2> turn;
                                       const double w = sides[0] > 0 ? 41.0 : 37.0;
                                       turn << 0, -w, w, 0;
                                       return affine<2>(Vector<2>::Zero(), turn, x);
                                     });
  const double half_turns = 1.0 / (M_PI / 41 + M_PI / 37) * 2;
  const auto found = follow<2>(velocity, Vector<2>(1, 1e-3), 0, 1);
  EXPECT_EQ(found.ending, TrajectoryEnd::Complete);
  EXPECT_EQ(found.count(EventKind::Crossing), static_cast<int>(half_turns));
  TrajectoryOptions few;
  few.max_events = 5;
  const auto stopped = follow<2>(velocity, Vector<2>(1, 1e-3), 0, 1, few);
  EXPECT_EQ(stopped.ending, TrajectoryEnd::TooManyEvents);
  EXPECT_LT(stopped.time, 1);
  EXPECT_EQ(stopped.events.size(), 5u);
}

// The time of an event and the end point converge with the order of the steps where steps are fixed from outside.
TEST(Trajectory, LocatesEventsWithTheOrderOfTheSteps) {
  const AnalyticVelocity<2> velocity({growing_ball<2>(1, 0.1)}, [](double t, const Vector<2>& x, const Sides& sides) {
    return wave<2>(sides[0] > 0 ? 3 : 5, 3 * t, x, 3) + affine<2>(Vector<2>(1.5, 0.3), Matrix<2>::Zero(), x);
  });
  TrajectoryOptions exact;
  exact.position_tolerance = exact.fundamental_tolerance = 1e-13;
  exact.max_step = 0.01;
  const auto reference = follow<2>(velocity, Vector<2>(-1.4, 0.1), 0, 1, exact);
  ASSERT_EQ(reference.count(EventKind::Crossing), 1);
  double errors[2];
  for (int i = 0; i < 2; ++i) {
    TrajectoryOptions fixed;
    fixed.position_tolerance = fixed.fundamental_tolerance = 1e3;
    fixed.max_step = i == 0 ? 0.1 : 0.05;
    const auto found = follow<2>(velocity, Vector<2>(-1.4, 0.1), 0, 1, fixed);
    ASSERT_EQ(found.count(EventKind::Crossing), 1);
    errors[i] = std::abs(found.events[0].time - reference.events[0].time);
    const SurfaceJet<2>& hit = found.events[0].jet;
    EXPECT_LE(std::abs(hit.value) / hit.gradient.norm(), fixed.event_tolerance)
        << "long steps, and still on the surface";
  }
  EXPECT_LT(errors[0], 1e-5);
  EXPECT_GT(std::log2(errors[0] / errors[1]), 3.8);
}

template <int Dim>
void check_fundamental_of_curved_crossings() {
  const AnalyticVelocity<Dim> velocity(
      {growing_ball<Dim>(1, 0.15), moving_plane<Dim>(Vector<Dim>::Unit(0), 0.1, -0.2, 3)},
      [](double t, const Vector<Dim>& x, const Sides& sides) {
        return wave<Dim>(1 + (sides[0] > 0) + 2 * (sides[1] > 0), t, x) +
               affine<Dim>(1.2 * Vector<Dim>::Unit(0), Matrix<Dim>::Zero(), x);
      });
  Vector<Dim> start = Vector<Dim>::Constant(0.2);
  start[0] = -1.5;
  TrajectoryOptions fine;
  fine.position_tolerance = 1e-12;
  const auto found = follow<Dim>(velocity, start, 0, 3.5, fine);
  ASSERT_EQ(found.ending, TrajectoryEnd::Complete);
  ASSERT_EQ(found.count(EventKind::Crossing), 3) << "into the ball, the plane, out of the ball";
  double errors[2];
  for (int i = 0; i < 2; ++i)
    errors[i] =
        (found.fundamental - differenced_fundamental<Dim>(velocity, start, 0, 3.5, i == 0 ? 2e-2 : 5e-3, fine)).norm();
  EXPECT_LT(errors[1], 1e-3);
  EXPECT_GT(std::log2(errors[0] / errors[1]) / 2, 1.8) << "central differences: order 2";
}

TEST(Trajectory, FundamentalMatrixEqualsDifferencesIn2D) { check_fundamental_of_curved_crossings<2>(); }
TEST(Trajectory, FundamentalMatrixEqualsDifferencesIn3D) { check_fundamental_of_curved_crossings<3>(); }

TEST(Trajectory, SlidesOnAMovingPlaneWithFilippovsVelocity) {
  const Vector<2> n(0, 1), minus(1, 1), plus(-0.5, -2);
  const double c = 0.25;
  const auto found = follow<2>(constant_sides<2>(n, 0.2, c, minus, plus, 3.0), Vector<2>(0, 0), 0, 1);
  const double hit = 0.2 / (1 - c), a = (1 - c) / 3;
  const Vector<2> along = a * plus + (1 - a) * minus;
  ASSERT_EQ(found.count(EventKind::Sliding), 1);
  EXPECT_EQ(found.ending, TrajectoryEnd::Complete);
  EXPECT_LT((found.position - (hit * minus + (1 - hit) * along)).norm(), 1e-10);
  EXPECT_NEAR(found.fundamental.determinant(), 0, 1e-11);
  Matrix<2> S = Matrix<2>::Identity() + (along - minus) * n.transpose() / (1 - c);
  EXPECT_LT((found.fundamental - S).norm(), 1e-10);
}

// v- = (1, 1 - t): goes into the line until t = 1, and then carries away from it.
TEST(Trajectory, SlidesAndLeavesWhenTheFlowTurns) {
  const AnalyticVelocity<2> velocity({moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                                     [](double t, const Vector<2>&, const Sides& sides) {
                                       const Vector<2> v = sides[0] > 0 ? Vector<2>(0, -1) : Vector<2>(1, 1 - t);
                                       return VelocityJet<2>{v, Matrix<2>::Zero()};
                                     });
  const auto found = follow<2>(velocity, Vector<2>(0, -0.375), 0, 2);  // t - t^2/2 = 0.375 at t = 0.5
  ASSERT_EQ(found.events.size(), 2u);
  EXPECT_EQ(found.events[0].kind, EventKind::Sliding);
  EXPECT_NEAR(found.events[0].time, 0.5, 1e-9);
  EXPECT_EQ(found.events[1].kind, EventKind::Leaving);
  EXPECT_NEAR(found.events[1].time, 1.0, 1e-8);
  EXPECT_EQ(found.events[1].saltation, Matrix<2>::Identity());
  // Sliding: a = (1-t)/(2-t), v_s = (1-a, 0) = (1/(2-t), 0); integral from 0.5 to 1 is log 1.5.
  EXPECT_NEAR(found.position[0], 0.5 + std::log(1.5) + 1.0, 1e-8);
  EXPECT_NEAR(found.position[1], -0.5, 1e-8);
  const Matrix<2> differences = differenced_fundamental<2>(velocity, Vector<2>(0, -0.375), 0, 2, 1e-4);
  EXPECT_LT((found.fundamental - differences).norm(), 1e-5);
}

// On a circle the sliding velocity turns with the normal: differences see the curvature terms of D v_s.
TEST(Trajectory, SlidesOnACircle) {
  const AnalyticVelocity<2> velocity({growing_ball<2>(1, 0.1)}, [](double t, const Vector<2>& x, const Sides& sides) {
    Matrix<2> flow;
    flow << 0, -0.7, 0.7, 0;
    flow += (sides[0] > 0 ? -0.8 : 0.9) * Matrix<2>::Identity();
    return affine<2>(Vector<2>(0.1, sides[0] > 0 ? 0.2 : -0.1), flow, x) + wave<2>(sides[0] > 0, t, x, 0.3);
  });
  TrajectoryOptions fine;
  fine.position_tolerance = 1e-12;
  for (const Vector<2>& start : {Vector<2>(0.7, 0.1), Vector<2>(-0.2, 1.4)}) {
    const auto found = follow<2>(velocity, start, 0, 1.5, fine);
    ASSERT_EQ(found.count(EventKind::Sliding), 1);
    ASSERT_EQ(found.ending, TrajectoryEnd::Complete);
    EXPECT_NEAR(found.position.norm(), 1.15, 1e-9);
    const double errors[2] = {
        (found.fundamental - differenced_fundamental<2>(velocity, start, 0, 1.5, 2e-2, fine)).norm(),
        (found.fundamental - differenced_fundamental<2>(velocity, start, 0, 1.5, 5e-3, fine)).norm()};
    EXPECT_LT(errors[1], 1e-4);
    EXPECT_GT(std::log2(errors[0] / errors[1]) / 2, 1.8);
  }
}

TEST(Trajectory, NamesAnEscapingSurface) {
  const auto velocity = constant_sides<2>(Vector<2>(0, 1), 0, 0, Vector<2>(0, -1), Vector<2>(0, 1));
  EXPECT_EQ(follow<2>(velocity, Vector<2>(0, 0), 0, 1).ending, TrajectoryEnd::Escaping);
  // Backwards in time the same surface attracts.
  const auto back = follow<2>(ReversedVelocity<2>(velocity), Vector<2>(0, 0.3), -1, 0);
  EXPECT_EQ(back.count(EventKind::Sliding), 1);
}

// Both sides turn at t = 1, and a point that slides has two ways to go.
TEST(Trajectory, NamesASurfaceThatTurnsIntoAnEscapingOne) {
  const AnalyticVelocity<2> velocity({moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                                     [](double t, const Vector<2>&, const Sides& sides) {
                                       const Vector<2> v(1, sides[0] > 0 ? t - 1 : 1 - t);
                                       return VelocityJet<2>{v, Matrix<2>::Zero()};
                                     });
  const auto found = follow<2>(velocity, Vector<2>(0, -0.1), 0, 2);
  EXPECT_EQ(found.count(EventKind::Sliding), 1);
  EXPECT_EQ(found.ending, TrajectoryEnd::Escaping);
  EXPECT_NEAR(found.time, 1, 1e-6);
  EXPECT_LT((found.position - Vector<2>(1, 0)).norm(), 1e-6);
}

TEST(Trajectory, NamesGrazingInsteadOfALargeNumber) {
  for (double slope : {1e-4, 1e-7}) {
    const auto velocity = constant_sides<2>(Vector<2>(0, 1), 0, 0, Vector<2>(1, slope), Vector<2>(-1, slope));
    const auto found = follow<2>(velocity, Vector<2>(0, -0.3 * slope), 0, 1);
    EXPECT_EQ(found.ending, TrajectoryEnd::Grazing) << slope;
    EXPECT_LT(found.fundamental.norm(), 2) << slope;
    TrajectoryOptions keep;
    keep.when_grazing = GrazingRule::KeepSide;
    const auto kept = follow<2>(velocity, Vector<2>(0, -0.3 * slope), 0, 1, keep);
    EXPECT_EQ(kept.ending, TrajectoryEnd::Complete);
    EXPECT_EQ(kept.count(EventKind::Grazing), 1);
    EXPECT_LT((kept.position - Vector<2>(1, 0.7 * slope)).norm(), 1e-12);
  }
  // Just above the bound it is a crossing, with a large but true matrix.
  const auto steep = constant_sides<2>(Vector<2>(0, 1), 0, 0, Vector<2>(1, 2e-3), Vector<2>(-1, 2e-3));
  const auto found = follow<2>(steep, Vector<2>(0, -1e-3), 0, 1);
  ASSERT_EQ(found.count(EventKind::Crossing), 1);
  EXPECT_NEAR(found.fundamental(0, 1), -2 / 2e-3, 1e-6);
}

// Touches the circle from outside at a tangent: |x| has a minimum of 1 exactly, so n.v = 0 there.
TEST(Trajectory, NamesATouchAtATangent) {
  const AnalyticVelocity<2> velocity({growing_ball<2>(1, 0)}, [](double, const Vector<2>&, const Sides& sides) {
    return VelocityJet<2>{Vector<2>(1, sides[0] > 0 ? 0.0 : 0.7), Matrix<2>::Zero()};
  });
  EXPECT_EQ(follow<2>(velocity, Vector<2>(-0.5, 1 - 1e-9), 0, 1).ending, TrajectoryEnd::Grazing);
  EXPECT_EQ(follow<2>(velocity, Vector<2>(-0.5, 1 + 1e-6), 0, 1).events.size(), 0u);
}

TEST(Trajectory, CrossesACornerWhoseOrdersAgreeAndNamesOneWhereTheyDoNot) {
  const auto make = [](bool separable) {
    return AnalyticVelocity<2>({moving_plane<2>(Vector<2>(1, 0), 0, 0), moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                               [=](double, const Vector<2>&, const Sides& sides) {
                                 Vector<2> v(1, 1);
                                 if (sides[0] > 0) v[0] += 0.5;
                                 if (sides[1] > 0) v[1] += 0.25;
                                 if (!separable && sides[0] > 0 && sides[1] < 0) v[1] += 0.7;
                                 return VelocityJet<2>{v, Matrix<2>::Zero()};
                               });
  };
  const auto found = follow<2>(make(true), Vector<2>(-0.5, -0.5), 0, 1);
  ASSERT_EQ(found.ending, TrajectoryEnd::Complete);
  EXPECT_LT((found.position - Vector<2>(0.75, 0.625)).norm(), 1e-10);
  EXPECT_LT((found.fundamental - Matrix<2>(Vector<2>(1.5, 1.25).asDiagonal())).norm(), 1e-10);
  EXPECT_EQ(follow<2>(make(false), Vector<2>(-0.5, -0.5), 0, 1).ending, TrajectoryEnd::Corner);
}

TEST(Trajectory, NamesWhatIsNotFiniteAndRefusesNonsense) {
  const AnalyticVelocity<2> broken({}, [](double, const Vector<2>&, const Sides&) {
    return VelocityJet<2>{Vector<2>(std::nan(""), 0), Matrix<2>::Zero()};
  });
  EXPECT_EQ(follow<2>(broken, Vector<2>(0, 0), 0, 1).ending, TrajectoryEnd::NotFinite);
  EXPECT_THROW(follow<2>(broken, Vector<2>(0, 0), 1, 0), InvalidInput);
  TrajectoryOptions wrong;
  wrong.position_tolerance = 0;
  EXPECT_THROW(follow<2>(broken, Vector<2>(0, 0), 0, 1, wrong), InvalidInput);
}

}  // namespace
}  // namespace saltus
