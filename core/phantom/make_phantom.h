#pragma once

#include <cstdint>
#include <vector>

#include "core/grid/volume.h"
#include "core/phantom/phantom_options.h"
#include "core/phantom/scene.h"

namespace saltus {

/// A pair of images with the truth between them. Everything lives on one grid (phantom_grid); points are world mm.
/// Both images are sampled from closed-form functions, never resampled from each other, and carry different noise.
template <int Dim>
struct Phantom {
  Volume<Dim> fixed;
  Volume<Dim> moving;
  VectorVolume<Dim> displacement;          ///< true u: fixed(x) = moving(x + u(x)), exact on both sides
  VectorVolume<Dim> inverse_displacement;  ///< true w on the moving grid: moving(y) = fixed(y + w(y))

  struct Masks {
    Volume<Dim> inside;   ///< 1 on the inner side of the interface, fixed image; all 0 when nothing slides
    Volume<Dim> outside;  ///< 1 on the other side
    Volume<Dim> near;     ///< 1 within 3 voxels of the interface (3 times the smallest spacing)
    Volume<Dim> valid;    ///< 1 where errors count, see Scene::is_valid
  } masks;

  Volume<Dim> fixed_labels;  ///< thorax: 1 2 right and left lung, 3 4 right and left abdomen, 5 bone; others: 1 bright
  Volume<Dim> moving_labels;

  std::vector<Vector<Dim>> fixed_points;  ///< landmarks, matched by position in the list
  std::vector<Vector<Dim>> moving_points;

  double noise_sd = 0;                 ///< in intensity units
  double largest_displacement_mm = 0;  ///< over the valid voxels
};

/// Makes the phantom; equal options give equal results, whatever the number of threads. A clinical thorax
/// (256x256x94) takes seconds. Throws InvalidInput as make_scene does.
template <int Dim>
Phantom<Dim> make_phantom(const PhantomOptions& options);

/// The same of any scene, sampled on `grid`; `noise` and `seed` as in PhantomOptions.
template <int Dim>
Phantom<Dim> sample_phantom(const Scene<Dim>& scene, const ImageGrid<Dim>& grid, double noise, std::uint64_t seed);

}  // namespace saltus
