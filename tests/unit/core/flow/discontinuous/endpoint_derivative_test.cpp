#include "core/flow/discontinuous/endpoint_derivative.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/support/errors.h"
#include "tests/unit/core/flow/discontinuous/analytic_velocities.h"

namespace saltus {
namespace {

using namespace testing;

/// w jumps across the surfaces too, and each surface moves by G = cos(k + x.q + t).
template <int Dim>
class WavyChange : public FlowPerturbation<Dim> {
 public:
  WavyChange(bool velocity, bool surface) : velocity_(velocity), surface_(surface) {}
  Vector<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const override {
    int seed = 20;
    for (std::size_t k = 0; k < sides.size(); ++k) seed += (sides[k] > 0) << k;
    return velocity_ ? wave<Dim>(seed, t, x).value : Vector<Dim>(Vector<Dim>::Zero());
  }
  VelocityJet<Dim> velocity_jet(double t, const Vector<Dim>& x, const Sides& sides) const {
    int seed = 20;
    for (std::size_t k = 0; k < sides.size(); ++k) seed += (sides[k] > 0) << k;
    return velocity_ ? wave<Dim>(seed, t, x) : VelocityJet<Dim>{};
  }
  typename FlowPerturbation<Dim>::SurfaceChange surface(int k, double t, const Vector<Dim>& x) const override {
    typename FlowPerturbation<Dim>::SurfaceChange change;
    if (!surface_) return change;
    const double phase = 1 + k + 0.8 * x.sum() + t;
    change.value = 0.3 * std::cos(phase);
    change.gradient = Vector<Dim>::Constant(-0.3 * 0.8 * std::sin(phase));
    change.rate = -0.3 * std::sin(phase);
    return change;
  }
  Matrix<Dim> surface_hessian(int k, double t, const Vector<Dim>& x) const {
    return surface_ ? Matrix<Dim>(Matrix<Dim>::Constant(-0.3 * 0.64 * std::cos(1 + k + 0.8 * x.sum() + t)))
                    : Matrix<Dim>(Matrix<Dim>::Zero());
  }

 private:
  bool velocity_, surface_;
};

/// v + eps w, H + eps G.
template <int Dim>
class Changed : public PiecewiseVelocity<Dim> {
 public:
  Changed(const PiecewiseVelocity<Dim>& base, const WavyChange<Dim>& change, double eps)
      : base_(base), change_(change), eps_(eps) {}
  int surfaces() const override { return base_.surfaces(); }
  SurfaceJet<Dim> surface(int k, double t, const Vector<Dim>& x) const override {
    SurfaceJet<Dim> jet = base_.surface(k, t, x);
    const auto change = change_.surface(k, t, x);
    jet.value += eps_ * change.value;
    jet.gradient += eps_ * change.gradient;
    jet.rate += eps_ * change.rate;
    jet.hessian += eps_ * change_.surface_hessian(k, t, x);
    return jet;
  }
  VelocityJet<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const override {
    VelocityJet<Dim> jet = base_.velocity(t, x, sides);
    const VelocityJet<Dim> more = change_.velocity_jet(t, x, sides);
    jet.value += eps_ * more.value;
    jet.jacobian += eps_ * more.jacobian;
    return jet;
  }

 private:
  const PiecewiseVelocity<Dim>& base_;
  const WavyChange<Dim>& change_;
  double eps_;
};

/// Velocity alone, surfaces alone and both: the forward derivative against one-sided differences of the whole solver
/// (Taylor remainder of order 2), and its dual.
template <int Dim>
void check(const PiecewiseVelocity<Dim>& flow, const Vector<Dim>& start, double until, int events,
           double largest_step = 1e-2) {
  TrajectoryOptions fine;
  fine.position_tolerance = fine.fundamental_tolerance = 1e-12;
  fine.max_step = 0.05;
  fine.keep_steps = true;
  const auto base = follow<Dim>(flow, start, 0, until, fine);
  ASSERT_EQ(base.ending, TrajectoryEnd::Complete) << to_string(base.ending);
  ASSERT_EQ(static_cast<int>(base.events.size()), events);
  for (int what = 1; what < (events ? 4 : 2); ++what) {
    const WavyChange<Dim> change(what & 1, what & 2);
    const Vector<Dim> slope = endpoint_derivative<Dim>(flow, base, change);
    double remainder[3];
    double eps = largest_step;
    for (double& r : remainder) {
      const auto moved = follow<Dim>(Changed<Dim>(flow, change, eps), start, 0, until, fine);
      ASSERT_EQ(moved.events.size(), base.events.size());
      r = (moved.position - base.position - eps * slope).norm();
      eps /= 4;
    }
    EXPECT_GT(std::log2(remainder[0] / remainder[1]) / 2, 1.8) << "perturbation " << what;
    EXPECT_GT(std::log2(remainder[1] / remainder[2]) / 2, 1.8) << "perturbation " << what;
    const Vector<Dim> dual = Vector<Dim>::LinSpaced(0.4, 1.3);
    const EndpointDual<Dim> pulled = pull_back<Dim>(flow, base, dual);
    EXPECT_NEAR(pulled.pairing(change), dual.dot(slope), 1e-11 * (1 + slope.norm())) << "perturbation " << what;
    EXPECT_LT((pulled.at_start - base.fundamental.transpose() * dual).norm(), 1e-9 * (1 + base.fundamental.norm()));
  }
}

template <int Dim>
AnalyticVelocity<Dim> through(std::vector<typename AnalyticVelocity<Dim>::Surface> surfaces, double speed) {
  return AnalyticVelocity<Dim>(std::move(surfaces), [speed](double t, const Vector<Dim>& x, const Sides& sides) {
    int seed = 1;
    for (std::size_t k = 0; k < sides.size(); ++k) seed += (sides[k] > 0) << k;
    return wave<Dim>(seed, t, x) + affine<Dim>(speed * Vector<Dim>::Unit(0), Matrix<Dim>::Zero(), x);
  });
}

TEST(EndpointDerivative, WithoutACrossing) { check<2>(through<2>({}, 1), Vector<2>(-0.5, 0.2), 1, 0); }

TEST(EndpointDerivative, AcrossOneMovingPlane) {
  check<2>(through<2>({moving_plane<2>(Vector<2>(0.8, 0.6), 0.2, -0.3, 4)}, 1.2), Vector<2>(-0.5, 0.2), 1, 1);
}

TEST(EndpointDerivative, AcrossAGrowingCircleTwice) {
  check<2>(through<2>({growing_ball<2>(1, 0.1)}, 1.5), Vector<2>(-1.4, 0.2), 2.2, 2);
}

TEST(EndpointDerivative, AcrossManySurfacesIn3D) {
  check<3>(through<3>({growing_ball<3>(1, 0.1), moving_plane<3>(Vector<3>(0.6, 0, 0.8), 0.1, 0.1, 2),
                       moving_plane<3>(Vector<3>(1, 0, 0), 1.7, -0.1, 0.5)},
                      1.5),
           Vector<3>(-1.4, 0.2, -0.1), 2.2, 4);
}

TEST(EndpointDerivative, WhileSlidingOnACircleThatGrows) {
  const AnalyticVelocity<2> flow({growing_ball<2>(1, 0.1)}, [](double t, const Vector<2>& x, const Sides& sides) {
    Matrix<2> linear;
    linear << 0, -0.7, 0.7, 0;
    linear += (sides[0] > 0 ? -0.8 : 0.9) * Matrix<2>::Identity();
    return affine<2>(Vector<2>(0.1, sides[0] > 0 ? 0.2 : -0.1), linear, x) + wave<2>(sides[0] > 0, t, x, 0.3);
  });
  check<2>(flow, Vector<2>(0.7, 0.1), 1.5, 1);
  check<2>(flow, Vector<2>(-0.2, 1.4), 1.5, 1);
}

TEST(EndpointDerivative, ThroughSlidingAndLeaving) {
  const AnalyticVelocity<3> flow({moving_plane<3>(Vector<3>(0, 1, 0), 0, 0.1, 2)},
                                 [](double t, const Vector<3>& x, const Sides& sides) {
                                   const Vector<3> v = sides[0] > 0 ? Vector<3>(0, -2, 0.5) : Vector<3>(1, 1.2 - t, 0);
                                   return affine<3>(v, Matrix<3>::Zero(), x) + wave<3>(sides[0] > 0, t, x, 0.2);
                                 });
  check<3>(flow, Vector<3>(0, -0.3, 0.1), 2, 2, 2e-3);
}

// The steeper the derivative, the smaller the steps in which it shows; down to 20 times the bound of grazing.
TEST(EndpointDerivative, NearGrazing) {
  const AnalyticVelocity<2> flow({moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                                 [](double t, const Vector<2>& x, const Sides& sides) {
                                   return affine<2>(Vector<2>(sides[0] > 0 ? -1 : 1, 0.02), Matrix<2>::Zero(), x) +
                                          affine<2>(Vector<2>(0, 0), 0.01 * t * Matrix<2>::Identity(), x);
                                 });
  check<2>(flow, Vector<2>(0, -0.01), 1, 1, 1e-3);
}

TEST(EndpointDerivative, IsRefusedWhereItDoesNotExist) {
  const AnalyticVelocity<2> flow({moving_plane<2>(Vector<2>(0, 1), 0, 0)},
                                 [](double, const Vector<2>&, const Sides& sides) {
                                   return VelocityJet<2>{Vector<2>(0, sides[0] > 0 ? 1 : -1), Matrix<2>::Zero()};
                                 });
  TrajectoryOptions options;
  options.keep_steps = true;
  const WavyChange<2> change(true, true);
  EXPECT_THROW(endpoint_derivative<2>(flow, follow<2>(flow, Vector<2>(0, 0), 0, 1, options), change), InvalidInput);
  EXPECT_THROW(endpoint_derivative<2>(flow, follow<2>(flow, Vector<2>(0, 1), 0, 1), change), InvalidInput);
}

}  // namespace
}  // namespace saltus
