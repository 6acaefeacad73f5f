#pragma once

#include <array>

#include "core/phantom/blob_texture.h"
#include "core/phantom/lung_motion.h"
#include "core/phantom/scene.h"
#include "core/phantom/vessel_tree.h"

namespace saltus {

/// A CT of the thorax in Hounsfield units, fixed at exhale and moving at inhale: body wall, ribs, spine, sternum, heart
/// and great vessels stay; two columns of lung and abdomen glide along them (LungMotion). Lung tissue keeps its mass,
/// fixed HU + 1000 = (moving HU + 1000) det D psi, while vessels keep their density. Landmarks are the branchings of
/// the lung vessels. Anatomy scales with the field of view, textures and vessels do not.
class ThoraxScene final : public Scene<3> {
 public:
  ThoraxScene(const PhantomOptions& options, const ImageGrid<3>& grid);

  double fixed(const Vector<3>& x) const override;
  double moving(const Vector<3>& y) const override;
  Vector<3> to_moving(const Vector<3>& x) const override;
  Vector<3> to_fixed(const Vector<3>& y) const override;
  double jacobian(const Vector<3>& x) const override;
  double interface_distance(const Vector<3>& x) const override;
  bool is_valid(const Vector<3>& x) const override;
  int fixed_label(const Vector<3>& x) const override;
  int moving_label(const Vector<3>& y) const override;
  std::vector<Vector<3>> moving_landmarks() const override;

 private:
  /// The column around a point and its organ coordinates; none when the point belongs to the wall.
  struct Place {
    int side = -1;
    Vector<3> organ;
  };
  Place place_of(const Vector<3>& world) const;

  VesselTree grow_vessels(int side) const;
  double organ_intensity(int side, const Vector<3>& organ, double compression) const;
  double wall_intensity(const Vector<3>& world) const;
  double bone_share(const Vector<3>& world) const;

  PhantomOptions options_;
  ImageGrid<3> grid_;
  Vector<3> extent_;
  Vector<2> body_;
  double softness_;
  std::array<LungMotion, 2> lungs_;
  BlobTexture<3> soft_tissue_;
  BlobTexture<3> fat_;
  BlobTexture<3> lung_tissue_;
  std::array<VesselTree, 2> vessels_;
};

}  // namespace saltus
