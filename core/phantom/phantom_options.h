#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace saltus {

/// Rectangle and Wheel are the paper's scenes, Slip is textured, Thorax is a 3-D CT, Smooth does not slide.
enum class PhantomKind { Rectangle, Wheel, Slip, Thorax, Smooth };
/// A straight line (in 3-D a plane parallel to z) or a circle (a cylinder along z) about the centre of the image.
enum class InterfaceShape { Line, Circle };
/// Plain: intensity ramps, which cannot show motion along their level lines. Blobs: blobs of three scales.
enum class TextureKind { Plain, Blobs };

/// What a phantom is made of. Defaults depend on the kind, see default_phantom_options; fields that a kind does not
/// name in its comment are not used by it. Lengths are mm; 2-D scenes have 1 mm pixels unless told otherwise.
struct PhantomOptions {
  PhantomKind kind = PhantomKind::Slip;
  int dimension = 2;                                ///< rectangle, slip, smooth: 2 or 3; wheel 2; thorax 3
  std::array<int, 3> size{128, 128, 1};             ///< voxels; the third counts in 3-D only
  std::array<double, 3> spacing{1, 1, 1};           ///< mm
  InterfaceShape interface = InterfaceShape::Line;  ///< slip
  double angle_deg = 0;                             ///< rectangle, slip: of a straight interface, from +x towards +y
  double radius_mm = 36;                            ///< wheel, slip with a circle
  double slip_mm = 6;           ///< rectangle, slip: tangential jump at the interface; each side moves half of it
  double rotation_deg = 5;      ///< wheel: each side turns by this angle, in opposite directions
  double displacement_mm = 20;  ///< thorax, smooth: scale of the largest displacement
  TextureKind texture = TextureKind::Blobs;  ///< rectangle, wheel
  double noise = 0.03;     ///< sd of the white noise, as a fraction of the intensity range; each image has its own
  std::uint64_t seed = 1;  ///< of texture, vessels, landmarks and noise
};

/// The paper's rectangle (80x80, 10 px slip) and wheel (202x202, radius 59, 5 degrees each way), without noise;
/// slip 128x128 with 6 px and 3 % noise; thorax 96x72x80 at 3 mm with 20 mm; smooth 128x128 (3-D: 64^3) with 8 mm.
/// Throws InvalidInput when the kind does not exist in that dimension. `dimension` 0 means the kind's usual one.
PhantomOptions default_phantom_options(PhantomKind kind, int dimension = 0);

/// Every reason why `options` cannot be used; empty when all is well.
std::vector<std::string> problems(const PhantomOptions& options);

std::string to_string(PhantomKind kind);
std::string to_string(InterfaceShape shape);
std::string to_string(TextureKind texture);

/// The inverses of to_string. Throw InvalidInput that lists the names there are.
PhantomKind parse_phantom_kind(std::string_view text);
InterfaceShape parse_interface_shape(std::string_view text);
TextureKind parse_texture_kind(std::string_view text);

}  // namespace saltus
