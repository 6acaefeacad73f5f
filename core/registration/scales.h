#pragma once

#include "core/momenta/momentum_scale.h"
#include "core/registration/options.h"

#include <limits>
#include <memory>
#include <vector>

namespace saltus {

/// A momentum scale and the finest pyramid level (0 is full resolution) from which on it takes part.
template <int Dim, class T>
struct PlacedScale {
  int level = 0;
  std::unique_ptr<MomentumScale<Dim, T>> scale;
};

/// Of oriented elements in their plane, in sites: half a width in 3-D, where without it there would be nine times as
/// many; measured, core/measurements.md, "Slip at any orientation".
template <int Dim>
inline constexpr int kElementSpacing = Dim == 3 ? 3 : 1;

/// What narrow widths of order 0 count where narrow_width_shear finds nothing sharp.
inline constexpr double kNarrowShareOfSmooth = 0.2;

/// Lattice of pyramid level `level`: the reference spacing (the finest of the image) times 2^level, where the image is
/// fine enough for it.
template <int Dim>
Lattice<Dim> level_lattice(const Lattice<Dim>& image, int level);

/// That of the moving image beside it.
template <int Dim>
Lattice<Dim> moving_level_lattice(const Lattice<Dim>& fixed, const Lattice<Dim>& moving, int level);

/// What of an image the options may follow.
struct ImageTraits {
  double noise = 0;  ///< standard deviation, as a share of the intensity range
  /// Intensity range a voxel at full resolution, see rms_gradient; infinite where nothing asks for it.
  double contrast = std::numeric_limits<double>::infinity();
};

/// Replaces what is automatic (levels, scales, widths, what follows noise and contrast) by what it means for a fixed
/// image like that on this lattice. What is resolved stays as it is when resolved again. No noise asks for the most
/// memory.
template <int Dim>
RegistrationOptions resolved(const RegistrationOptions& options, const Lattice<Dim>& image,
                             const ImageTraits& traits = {});

/// Whether, by resolved options, the scales of order 1 beside a Gaussian order 0 have oriented momenta and none along
/// the axes.
bool has_oriented_alone(const RegistrationOptions::Momenta& momenta);

/// Width of the kernel of the first-order momenta of scale q, mm, by resolved options.
template <int Dim>
double first_order_width(const Lattice<Dim>& image, const RegistrationOptions& options, int q);

/// Where the flow is on a level with first orders, by resolved options: on the lattice of their finest scale, but for
/// one that is finer than the level's, and no coarser than beside order 0 alone (flow.coarsening).
template <int Dim>
Lattice<Dim> flow_lattice_beside_first(const Lattice<Dim>& image, const RegistrationOptions& options, int level);

/// The scales that resolved options ask for, coarsest first. Scale q lives on the lattice of level q; its kernel has
/// the width width_voxels * reference spacing * 2^q, or is the sum of widths that kernel_widths (order 1 alone:
/// first_order_kernel_widths) asks for. The order-0 kernel of `sliding` is Gaussian, its order-1 kernel Wendland.
/// `directions` are those of frame_directions, for model directional. Widths of kernel_widths but the widest count
/// `narrow_share` in the finest scale that has order 0.
template <int Dim, class T>
std::vector<PlacedScale<Dim, T>> make_scales(const Lattice<Dim>& image, const RegistrationOptions& options,
                                             const Field<double>& directions = {}, double narrow_share = 1);

}  // namespace saltus
