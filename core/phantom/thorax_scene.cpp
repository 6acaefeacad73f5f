#include "core/phantom/thorax_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/phantom/scene_support.h"
#include "core/support/random.h"

namespace saltus {
namespace {

constexpr int kRightLung = 1, kRightAbdomen = 3, kBone = 5;

Vector<3> extent_of(const ImageGrid<3>& grid) {
  return {grid.size[0] * grid.spacing[0], grid.size[1] * grid.spacing[1], grid.size[2] * grid.spacing[2]};
}

Vector<2> body_axes(const Vector<3>& extent) { return {0.47 * extent[0], 0.46 * std::min(extent[1], 0.8 * extent[0])}; }

/// 1 well inside, 0 well outside, for a signed distance that is negative inside.
double edge(double distance, double softness) {
  const double t = std::clamp(0.5 - 0.5 * distance / softness, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

double blend(double from, double to, double share) { return from + share * (to - from); }

double ellipse_radius(const Vector<3>& p, const Vector<2>& semi_axes) {
  return std::hypot(p[0] / semi_axes[0], p[1] / semi_axes[1]);
}

}  // namespace

ThoraxScene::ThoraxScene(const PhantomOptions& options, const ImageGrid<3>& grid)
    : options_(options),
      grid_(grid),
      extent_(extent_of(grid)),
      body_(body_axes(extent_)),
      softness_(std::max(1.0, 0.5 * grid.spacing.maxCoeff())),
      lungs_{LungMotion(LungMotion::Side::Right, body_, extent_[2], options.displacement_mm),
             LungMotion(LungMotion::Side::Left, body_, extent_[2], options.displacement_mm)},
      soft_tissue_({{30, 22}, {14, 18}, {8, 14}}, options.seed),
      fat_({{26, 1}, {13, 0.8}}, random_bits(options.seed, {3})),
      lung_tissue_({{18, 30}, {9, 22}}, random_bits(options.seed, {4})),
      vessels_{grow_vessels(0), grow_vessels(1)} {}

VesselTree ThoraxScene::grow_vessels(int side) const {
  constexpr int kTargets = 480;
  const LungMotion& lung = lungs_[side];
  RandomSequence random(options_.seed, 31 + side);
  const Vector<3> hilum = lung.to_world({-0.8, 0.1, 0.03 * extent_[2]});
  const double lowest = -0.45 * extent_[2];
  auto has_room = [&lung](const Vector<3>& world, double room) {
    const Vector<3> organ = lung.to_organ(world);
    return lung.wall_distance(world) < -room && organ[2] > lung.diaphragm(organ) + room &&
           organ[2] < lung.cap(organ) - room;
  };
  std::vector<Vector<3>> targets;
  for (int draw = 0; draw < 200000 && targets.size() < kTargets; ++draw) {
    Vector<3> organ(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(lowest, lung.apex_mm()));
    const Vector<3> world = lung.to_world(organ);
    if (!has_room(world, 1.5)) continue;
    // The first targets make the trunks, in the middle of the organ; of the later ones, two in three lie in the outer
    // 4 mm, so that vessels, and landmarks, come close to the sliding wall.
    const double depth = -lung.wall_distance(world);
    const bool wants_rim = targets.size() >= 60 && targets.size() % 3 != 0;
    if (targets.size() < 24 ? depth < 10 : wants_rim && depth > 4) continue;
    targets.push_back(world);
  }
  return VesselTree(hilum, targets, [&](const Vector<3>& world) { return has_room(world, 0.5); },
                    {.leaf_radius_mm = 0.8, .softness_mm = softness_, .clearance_mm = 4});
}

ThoraxScene::Place ThoraxScene::place_of(const Vector<3>& world) const {
  const int side = world[0] < 0 ? 0 : 1;
  const Vector<3> organ = lungs_[side].to_organ(world);
  if (organ[0] * organ[0] + organ[1] * organ[1] < 1 && organ[2] < lungs_[side].cap(organ)) return {side, organ};
  return {-1, organ};
}

double ThoraxScene::organ_intensity(int side, const Vector<3>& organ, double compression) const {
  const Vector<3> world = lungs_[side].to_world(organ);
  if (lungs_[side].is_lung(organ)) {
    const double tissue = -850 + 35 * organ[1] + lung_tissue_(world);
    return blend((tissue + 1000) * compression - 1000, 45, vessels_[side](world));
  }
  return (side == 0 ? 105 : 60) + 2 * soft_tissue_(world);
}

double ThoraxScene::bone_share(const Vector<3>& p) const {
  const double sharp = 1.0;
  double share = 0;
  // Ribs descend from the spine to the front; none in front of the sternum.
  const double radius = ellipse_radius(p, body_);
  const double radial = (radius - 0.905) * 0.5 * (body_[0] + body_[1]) / 4.5;
  if (std::abs(radial) < 2 && p[1] > -0.75 * body_[1]) {
    constexpr double kPitch = 25;
    const double level = p[2] - 0.32 * p[1] - 0.02 * p[0];
    const double vertical = (level - kPitch * std::round(level / kPitch)) / 6.5;
    share = edge((std::hypot(radial, vertical) - 1) * 4.5, sharp);
  }
  const double sternum = std::hypot(p[0] / 16, (p[1] + 0.85 * body_[1]) / 6) - 1;
  if (p[2] > -0.2 * extent_[2]) share = std::max(share, edge(6 * sternum, sharp));
  // Vertebral bodies with discs between them, and the arch behind the canal.
  constexpr double kVertebra = 27;
  const double along = std::abs(p[2] - kVertebra * std::round(p[2] / kVertebra));
  const Vector<2> spine(p[0], p[1] - 0.60 * body_[1]);
  const double waist = 17 - 2.5 * std::cos(2 * 3.14159265358979323846 * p[2] / kVertebra);
  const double vertebra = std::max(std::hypot(spine[0] / 1.15, spine[1]) - waist, along - 10.5);
  const double canal = std::hypot(spine[0], spine[1] - 24);
  const double arch = std::max(std::abs(canal - 12) - 3, along - 9);
  return std::max({share, edge(vertebra, sharp), edge(arch, sharp)});
}

double ThoraxScene::wall_intensity(const Vector<3>& p) const {
  const double radius = ellipse_radius(p, body_);
  if (radius >= 1) return -1000;
  const double texture = soft_tissue_(p);
  const double fatty = std::clamp((fat_(p) - 0.05) / 0.5, 0.0, 1.0);
  double value = 50 + texture - 130 * fatty * fatty * (3 - 2 * fatty);
  const double skin = (1 - radius) * 0.5 * (body_[0] + body_[1]);
  value = blend(value, -105 + 0.6 * texture, edge(skin < 2.5 ? 99 : skin - 9, softness_));

  const Vector<3> heart((p[0] - 0.03 * body_[0]) / (0.18 * body_[0]), (p[1] + 0.22 * body_[1]) / (0.36 * body_[1]),
                        (p[2] + 0.08 * extent_[2]) / (0.18 * extent_[2]));
  value = blend(value, 60 + 0.7 * texture, edge(20 * (heart.norm() - 1), softness_));
  const double aorta = std::hypot(p[0] - 0.10 * body_[0], p[1] - 0.33 * body_[1]) - 9;
  value = blend(value, 150 + 0.3 * texture, edge(aorta, softness_));
  const double trachea = std::max(std::hypot(p[0], p[1] - 0.1 * body_[1]) - 8, 0.12 * extent_[2] - p[2]);
  value = blend(value, -990, edge(trachea, softness_));
  return blend(value, 450 + 4 * texture, bone_share(p));
}

double ThoraxScene::moving(const Vector<3>& y) const {
  const Place place = place_of(y);
  return place.side < 0 ? wall_intensity(y) : organ_intensity(place.side, place.organ, 1);
}

double ThoraxScene::fixed(const Vector<3>& x) const {
  const Place place = place_of(x);
  if (place.side < 0) return wall_intensity(x);
  const LungMotion& lung = lungs_[place.side];
  return organ_intensity(place.side, lung.to_moving(place.organ), lung.jacobian(place.organ));
}

Vector<3> ThoraxScene::to_moving(const Vector<3>& x) const {
  const Place place = place_of(x);
  if (place.side < 0 || x[2] >= lungs_[place.side].still_above_mm()) return x;
  return lungs_[place.side].to_world(lungs_[place.side].to_moving(place.organ));
}

Vector<3> ThoraxScene::to_fixed(const Vector<3>& y) const {
  const Place place = place_of(y);
  if (place.side < 0 || y[2] >= lungs_[place.side].still_above_mm()) return y;
  return lungs_[place.side].to_world(lungs_[place.side].to_fixed(place.organ));
}

double ThoraxScene::jacobian(const Vector<3>& x) const {
  const Place place = place_of(x);
  return place.side < 0 ? 1 : lungs_[place.side].jacobian(place.organ);
}

double ThoraxScene::interface_distance(const Vector<3>& x) const {
  const LungMotion& lung = lungs_[x[0] < 0 ? 0 : 1];
  return x[2] < lung.still_above_mm() ? lung.wall_distance(x) : std::numeric_limits<double>::infinity();
}

bool ThoraxScene::is_valid(const Vector<3>& x) const {
  return ellipse_radius(x, body_) < 1 && is_inside<3>(grid_, x, 0) && is_inside<3>(grid_, to_moving(x), 0);
}

int ThoraxScene::moving_label(const Vector<3>& y) const {
  const Place place = place_of(y);
  if (place.side < 0) return ellipse_radius(y, body_) < 1 && bone_share(y) > 0.5 ? kBone : 0;
  return place.side + (lungs_[place.side].is_lung(place.organ) ? kRightLung : kRightAbdomen);
}

int ThoraxScene::fixed_label(const Vector<3>& x) const {
  const Place place = place_of(x);
  if (place.side < 0) return moving_label(x);
  const LungMotion& lung = lungs_[place.side];
  return place.side + (lung.is_lung(lung.to_moving(place.organ)) ? kRightLung : kRightAbdomen);
}

std::vector<Vector<3>> ThoraxScene::moving_landmarks() const {
  std::vector<Vector<3>> points;
  for (const VesselTree& tree : vessels_)
    for (const Vector<3>& point : tree.branchings())
      if (is_inside<3>(grid_, point, 0) && is_inside<3>(grid_, to_fixed(point), 0)) points.push_back(point);
  return points;
}

}  // namespace saltus
