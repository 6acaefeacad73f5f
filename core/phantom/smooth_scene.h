#pragma once

#include "core/phantom/blob_texture.h"
#include "core/phantom/scene.h"

namespace saltus {

/// A scene without sliding: shears along each axis, sinusoidal in the other axes, after a sinusoidal stretch of each
/// axis, so that volumes change. Each step has an inverse, the stretch by Newton's method.
template <int Dim>
class SmoothScene final : public Scene<Dim> {
 public:
  SmoothScene(const PhantomOptions& options, const ImageGrid<Dim>& grid);

  double moving(const Vector<Dim>& y) const override { return 128 + texture_(y); }
  Vector<Dim> to_moving(const Vector<Dim>& x) const override;
  Vector<Dim> to_fixed(const Vector<Dim>& y) const override;
  double jacobian(const Vector<Dim>& x) const override;
  double interface_distance(const Vector<Dim>& x) const override;
  bool is_valid(const Vector<Dim>& x) const override;
  int moving_label(const Vector<Dim>& y) const override { return moving(y) > 128 ? 1 : 0; }
  std::vector<Vector<Dim>> moving_landmarks() const override;

 private:
  double shear(const Vector<Dim>& p, int axis) const;

  PhantomOptions options_;
  ImageGrid<Dim> grid_;
  Vector<Dim> frequency_;  ///< radians per mm: one period over the image
  Vector<Dim> phase_;
  BlobTexture<Dim> texture_;
};

}  // namespace saltus
