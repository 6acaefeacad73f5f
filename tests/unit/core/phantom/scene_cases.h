#pragma once

#include <string>
#include <vector>

#include "core/phantom/phantom_options.h"

namespace saltus {

struct SceneCase {
  std::string name;
  PhantomOptions options;
};

/// One of every shape of map, small, without noise.
template <int Dim>
std::vector<SceneCase> scene_cases() {
  auto make = [](std::string name, PhantomKind kind, auto change) {
    PhantomOptions options = default_phantom_options(kind, Dim);
    options.noise = 0;
    change(options);
    return SceneCase{std::move(name), options};
  };
  auto as_is = [](PhantomOptions&) {};
  std::vector<SceneCase> cases{
      make("rectangle", PhantomKind::Rectangle, as_is),
      make("slip_27_degrees", PhantomKind::Slip, [](PhantomOptions& o) { o.angle_deg = 27; }),
      make("slip_circle", PhantomKind::Slip, [](PhantomOptions& o) { o.interface = InterfaceShape::Circle; }),
      make("slip_anisotropic", PhantomKind::Slip,
           [](PhantomOptions& o) {
             o.spacing = {0.7, 1.3, 2};
           }),
      make("smooth", PhantomKind::Smooth, as_is)};
  if constexpr (Dim == 2) {
    cases.push_back(make("wheel", PhantomKind::Wheel, as_is));
    cases.push_back(make("wheel_textured", PhantomKind::Wheel, [](PhantomOptions& o) {
      o.texture = TextureKind::Blobs;
      o.rotation_deg = 12;
    }));
  } else {
    for (SceneCase& scene : cases) scene.options.size = {40, 44, 24};
    for (SceneCase& scene : cases) scene.options.displacement_mm = 3;
    cases.push_back(make("thorax", PhantomKind::Thorax, as_is));
  }
  return cases;
}

}  // namespace saltus
