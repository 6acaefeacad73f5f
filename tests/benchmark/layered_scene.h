#pragma once

#include <functional>

#include "core/phantom/blob_texture.h"
#include "core/phantom/scene.h"

namespace saltus::benchmark {

/// Bodies that glide along x: psi(x, y) = (x + shift(x, y), y), textured by blobs. The interfaces are where the shift
/// jumps; with them straight lines of constant y, every side is kept. Needs d shift / dx > -1 and |shift| < 50 mm.
class LayeredScene final : public Scene<2> {
 public:
  struct Shape {
    std::function<double(const Vector<2>&)> shift;     ///< mm, of a fixed point
    std::function<double(const Vector<2>&)> distance;  ///< signed, from the nearest interface
    double gap_half_width_mm = 0;                      ///< without texture, on both sides of y = gap_at_mm
    double gap_at_mm = 0;
  };

  LayeredScene(Shape shape, const ImageGrid<2>& grid);

  double moving(const Vector<2>& y) const override;
  Vector<2> to_moving(const Vector<2>& x) const override;
  Vector<2> to_fixed(const Vector<2>& y) const override;
  double jacobian(const Vector<2>& x) const override;
  double interface_distance(const Vector<2>& x) const override { return shape_.distance(x); }
  bool is_valid(const Vector<2>& x) const override;
  int moving_label(const Vector<2>& y) const override { return moving(y) > 128 ? 1 : 0; }
  std::vector<Vector<2>> moving_landmarks() const override { return {}; }

 private:
  Shape shape_;
  ImageGrid<2> grid_;
  BlobTexture<2> texture_;
};

/// A strip of 2 * half_width_mm about y = centre glides against what is above and below it: two interfaces.
LayeredScene::Shape strip(double centre_mm, double half_width_mm, double slip_mm);

/// The upper half glides over the lower one up to x = full_until_mm; from there the slip fades and ends at `end_mm`.
LayeredScene::Shape ending_interface(double centre_mm, double slip_mm, double full_until_mm, double end_mm);

/// Two halves glide in opposite directions with an empty gap between them.
LayeredScene::Shape thin_gap(double centre_mm, double slip_mm, double gap_mm);

}  // namespace saltus::benchmark
