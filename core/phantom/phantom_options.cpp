#include "core/phantom/phantom_options.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "core/support/errors.h"

namespace saltus {
namespace {

template <typename Enum, std::size_t N>
using Names = std::array<std::pair<Enum, std::string_view>, N>;

constexpr Names<PhantomKind, 5> kKinds{{{PhantomKind::Rectangle, "rectangle"},
                                        {PhantomKind::Wheel, "wheel"},
                                        {PhantomKind::Slip, "slip"},
                                        {PhantomKind::Thorax, "thorax"},
                                        {PhantomKind::Smooth, "smooth"}}};
constexpr Names<InterfaceShape, 2> kShapes{{{InterfaceShape::Line, "line"}, {InterfaceShape::Circle, "circle"}}};
constexpr Names<TextureKind, 2> kTextures{{{TextureKind::Plain, "plain"}, {TextureKind::Blobs, "blobs"}}};

template <typename Enum, std::size_t N>
std::string name_of(const Names<Enum, N>& names, Enum value) {
  for (const auto& [candidate, name] : names)
    if (candidate == value) return std::string(name);
  return "unknown";
}

template <typename Enum, std::size_t N>
Enum value_of(const Names<Enum, N>& names, std::string_view what, std::string_view text) {
  std::string known;
  for (const auto& [value, name] : names) {
    if (name == text) return value;
    known += (known.empty() ? "" : ", ") + std::string(name);
  }
  throw InvalidInput(std::string(what) + " '" + std::string(text) + "' is not known; choose one of " + known + ".");
}

}  // namespace

PhantomOptions default_phantom_options(PhantomKind kind, int dimension) {
  PhantomOptions options;
  options.kind = kind;
  options.dimension = dimension != 0 ? dimension : (kind == PhantomKind::Thorax ? 3 : 2);
  if (options.dimension == 3) options.size = {64, 64, 64};
  switch (kind) {
    case PhantomKind::Rectangle:
      options.size = options.dimension == 3 ? std::array<int, 3>{80, 80, 40} : std::array<int, 3>{80, 80, 1};
      options.slip_mm = 10;
      options.texture = TextureKind::Plain;
      options.noise = 0;
      break;
    case PhantomKind::Wheel:
      options.size = {202, 202, 1};
      options.radius_mm = 59;
      options.texture = TextureKind::Plain;
      options.noise = 0;
      break;
    case PhantomKind::Slip:
      if (options.dimension == 3) options.radius_mm = 18;
      break;
    case PhantomKind::Thorax:
      options.size = {96, 72, 80};
      options.spacing = {3, 3, 3};
      options.noise = 0.015;
      break;
    case PhantomKind::Smooth:
      options.displacement_mm = options.dimension == 3 ? 5 : 8;
      break;
  }
  if (const auto found = problems(options); !found.empty()) throw InvalidInput(found.front());
  return options;
}

std::vector<std::string> problems(const PhantomOptions& options) {
  std::vector<std::string> found;
  auto report = [&found](const auto&... parts) {
    std::ostringstream text;
    (text << ... << parts);
    found.push_back(text.str());
  };
  auto finite = [&report](std::string_view name, double value) {
    if (!std::isfinite(value)) report(name, " is ", value, "; it must be a finite number.");
  };
  const std::string kind = to_string(options.kind);
  if (options.dimension != 2 && options.dimension != 3) report("dimension is ", options.dimension, "; choose 2 or 3.");
  if (options.kind == PhantomKind::Thorax && options.dimension != 3)
    report("dimension is ", options.dimension, "; the phantom thorax exists in 3-D only.");
  if (options.kind == PhantomKind::Wheel && options.dimension != 2)
    report("dimension is ", options.dimension, "; the phantom wheel exists in 2-D only.");
  const int axes = options.dimension == 3 ? 3 : 2;
  const int smallest = options.kind == PhantomKind::Thorax ? 16 : 8;
  double voxels = 1;
  for (int axis = 0; axis < axes; ++axis) {
    voxels *= options.size[axis];
    if (options.size[axis] < smallest)
      report("size[", axis, "] is ", options.size[axis], "; the phantom ", kind, " needs at least ", smallest, ".");
    if (!(options.spacing[axis] > 0) || !std::isfinite(options.spacing[axis]))
      report("spacing[", axis, "] is ", options.spacing[axis], " mm; it must be finite and positive.");
  }
  if (voxels > 1e9) report("size asks for ", voxels, " voxels; at most 1e9 are made.");
  if (options.kind == PhantomKind::Thorax)
    for (int axis = 0; axis < 3; ++axis)
      if (const double extent = options.size[axis] * options.spacing[axis]; extent < 150 || extent > 600)
        report("size[", axis, "] x spacing[", axis, "] is ", extent, " mm; a thorax needs between 150 and 600 mm.");
  finite("angle", options.angle_deg);
  finite("slip", options.slip_mm);
  finite("rotation", options.rotation_deg);
  finite("displacement", options.displacement_mm);
  if (!(options.radius_mm > 0) || !std::isfinite(options.radius_mm))
    report("radius is ", options.radius_mm, " mm; it must be finite and positive.");
  if (!(options.noise >= 0 && options.noise <= 10))
    report("noise is ", options.noise, "; it is a fraction of the intensity range, from 0 to 10.");
  // Beyond these amounts the maps would fold or the thorax would leave its own field of view.
  if (options.kind == PhantomKind::Thorax && !(options.displacement_mm >= 0 && options.displacement_mm <= 30))
    report("displacement is ", options.displacement_mm, " mm; a thorax moves by 0 to 30 mm.");
  if (options.kind == PhantomKind::Smooth && found.empty()) {
    double extent = options.size[0] * options.spacing[0];
    for (int axis = 1; axis < axes; ++axis) extent = std::min(extent, options.size[axis] * options.spacing[axis]);
    if (!(options.displacement_mm >= 0 && options.displacement_mm <= 0.15 * extent))
      report("displacement is ", options.displacement_mm, " mm; a smooth scene of this size moves by 0 to ",
             0.15 * extent, " mm.");
  }
  return found;
}

std::string to_string(PhantomKind kind) { return name_of(kKinds, kind); }
std::string to_string(InterfaceShape shape) { return name_of(kShapes, shape); }
std::string to_string(TextureKind texture) { return name_of(kTextures, texture); }

PhantomKind parse_phantom_kind(std::string_view text) { return value_of(kKinds, "phantom", text); }
InterfaceShape parse_interface_shape(std::string_view text) { return value_of(kShapes, "interface", text); }
TextureKind parse_texture_kind(std::string_view text) { return value_of(kTextures, "texture", text); }

}  // namespace saltus
