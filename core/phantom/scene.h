#pragma once

#include <memory>
#include <vector>

#include "core/grid/image_grid.h"
#include "core/phantom/phantom_options.h"

namespace saltus {

/// A pair of images and the motion between them as functions of world points, before any sampling.
/// `to_moving` is exact on both sides of the interface; `fixed(x)` is `moving(to_moving(x))` except where a scene says
/// that density changes with volume. Stateless after construction: any thread may call any method.
template <int Dim>
class Scene {
 public:
  virtual ~Scene() = default;

  /// Intensities without noise.
  virtual double fixed(const Vector<Dim>& x) const { return moving(to_moving(x)); }
  virtual double moving(const Vector<Dim>& y) const = 0;

  /// psi: fixed point -> moving point, x + u(x).
  virtual Vector<Dim> to_moving(const Vector<Dim>& x) const = 0;
  /// psi^-1, exact or solved to 1e-10 mm.
  virtual Vector<Dim> to_fixed(const Vector<Dim>& y) const = 0;
  /// det D psi(x), off the interface.
  virtual double jacobian(const Vector<Dim>& x) const = 0;

  /// Signed distance in mm from the sliding interface in the fixed image, negative on the inner side
  /// (rectangle and slip with a line: the side of small y). Infinite when nothing slides.
  virtual double interface_distance(const Vector<Dim>& x) const = 0;
  /// Whether errors at x count: x and to_moving(x) are both shown by the images.
  virtual bool is_valid(const Vector<Dim>& x) const = 0;

  /// Labels, 0 is background.
  virtual int fixed_label(const Vector<Dim>& x) const { return moving_label(to_moving(x)); }
  virtual int moving_label(const Vector<Dim>& y) const = 0;

  /// Points of the moving image that an observer could name.
  virtual std::vector<Vector<Dim>> moving_landmarks() const = 0;
};

/// The grid that both images of a phantom are sampled on: the origin is 0 in 2-D scenes and in their 3-D extrusions;
/// a thorax is centred on the world's origin.
template <int Dim>
ImageGrid<Dim> phantom_grid(const PhantomOptions& options);

/// Throws InvalidInput with the first of problems(options), or when Dim is not options.dimension.
template <int Dim>
std::unique_ptr<Scene<Dim>> make_scene(const PhantomOptions& options);

}  // namespace saltus
