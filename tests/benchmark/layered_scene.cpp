#include "tests/benchmark/layered_scene.h"

#include <algorithm>
#include <cmath>

#include "core/phantom/scene_support.h"

namespace saltus::benchmark {

LayeredScene::LayeredScene(Shape shape, const ImageGrid<2>& grid)
    : shape_(std::move(shape)), grid_(grid), texture_(grey_texture_scales<2>(), 1) {}

double LayeredScene::moving(const Vector<2>& y) const {
  if (std::abs(y[1] - shape_.gap_at_mm) < shape_.gap_half_width_mm) return 0;
  return 128 + texture_(y);
}

Vector<2> LayeredScene::to_moving(const Vector<2>& x) const { return {x[0] + shape_.shift(x), x[1]}; }

Vector<2> LayeredScene::to_fixed(const Vector<2>& y) const {
  double low = y[0] - 50, high = y[0] + 50;
  for (int halving = 0; halving < 80; ++halving) {
    const double middle = 0.5 * (low + high);
    (to_moving({middle, y[1]})[0] < y[0] ? low : high) = middle;
  }
  return {0.5 * (low + high), y[1]};
}

double LayeredScene::jacobian(const Vector<2>& x) const {
  constexpr double kStep = 1e-5;
  return 1 + (shape_.shift({x[0] + kStep, x[1]}) - shape_.shift({x[0] - kStep, x[1]})) / (2 * kStep);
}

bool LayeredScene::is_valid(const Vector<2>& x) const {
  return is_inside<2>(grid_, x, 1) && is_inside<2>(grid_, to_moving(x), 1);
}

LayeredScene::Shape strip(double centre_mm, double half_width_mm, double slip_mm) {
  LayeredScene::Shape shape;
  shape.distance = [=](const Vector<2>& x) { return std::abs(x[1] - centre_mm) - half_width_mm; };
  shape.shift = [=, distance = shape.distance](const Vector<2>& x) {
    return distance(x) < 0 ? -slip_mm / 2 : slip_mm / 2;
  };
  return shape;
}

LayeredScene::Shape ending_interface(double centre_mm, double slip_mm, double full_until_mm, double end_mm) {
  LayeredScene::Shape shape;
  shape.distance = [=](const Vector<2>& x) {
    const double across = x[1] - centre_mm, beyond = std::max(0.0, x[0] - end_mm);
    return std::copysign(std::hypot(across, beyond), across);
  };
  shape.shift = [=](const Vector<2>& x) {
    const double t = std::clamp((x[0] - full_until_mm) / (end_mm - full_until_mm), 0.0, 1.0);
    return std::copysign(slip_mm / 2, x[1] - centre_mm) * (1 - t * t * (3 - 2 * t));
  };
  return shape;
}

LayeredScene::Shape thin_gap(double centre_mm, double slip_mm, double gap_mm) {
  LayeredScene::Shape shape;
  shape.distance = [=](const Vector<2>& x) { return x[1] - centre_mm; };
  shape.shift = [=](const Vector<2>& x) { return std::copysign(slip_mm / 2, x[1] - centre_mm); };
  shape.gap_at_mm = centre_mm;
  shape.gap_half_width_mm = gap_mm / 2;
  return shape;
}

}  // namespace saltus::benchmark
