#pragma once

#include "core/phantom/blob_texture.h"
#include "core/phantom/scene.h"

namespace saltus {

/// Rectangle, wheel and slip: motion in the x-y plane, extruded along z in 3-D, that jumps across a line or a circle
/// through or about the scene's centre. Every map preserves each side and each area, and has a closed-form inverse.
///
///     line    psi(x) = x -+ (slip/2) t          t = (cos angle, sin angle); - on the side of small y
///     circle  psi(x) = c + R(a(r)) (x - c)      a = slip/(2 radius) inside, -slip/(2 r) outside: |u| along the arc
///     wheel   psi(x) = c + R(a(r)) (x - c)      a = rotation inside, -rotation outside
template <int Dim>
class PlanarScene final : public Scene<Dim> {
 public:
  PlanarScene(const PhantomOptions& options, const ImageGrid<Dim>& grid);

  double moving(const Vector<Dim>& y) const override;
  Vector<Dim> to_moving(const Vector<Dim>& x) const override;
  Vector<Dim> to_fixed(const Vector<Dim>& y) const override;
  double jacobian(const Vector<Dim>&) const override { return 1; }
  double interface_distance(const Vector<Dim>& x) const override;
  bool is_valid(const Vector<Dim>& x) const override;
  int moving_label(const Vector<Dim>& y) const override;
  std::vector<Vector<Dim>> moving_landmarks() const override;

 private:
  bool is_circle() const;
  Vector<Dim> moved(const Vector<Dim>& from, double sign) const;

  PhantomOptions options_;
  ImageGrid<Dim> grid_;
  Vector<2> centre_;
  Vector<2> tangent_;
  BlobTexture<Dim> texture_;
};

}  // namespace saltus
