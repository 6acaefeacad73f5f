#include "core/similarity/local_correlation_tile.h"
#include "core/similarity/middle_values.h"
#include "core/similarity/similarity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include <omp.h>

namespace saltus {
namespace {

/// The derivative at sample y collects the windows x that hold y. It is box sums of coefficients that depend on x alone
/// (WindowCorrelation). Nothing of this sees a constant that is taken off an image; both lose about their mean first,
/// because sums are made in T and a variance small against the mean would be lost in them.
///
/// One sweep along the last axis ("planes") does it all, so that memory sees both images and the gradient and nothing
/// else. For plane c of window centres two rows at a time go through the whole chain: their products are summed along
/// z, over planes c - r to c + r; those of 2 r + 1 rows along y, these along x, and that gives the coefficients of the
/// rows r before; these are summed along x and those of 2 r + 1 rows along y. What comes of two planes is summed along
/// z, over 2 r + 1 planes, and ends as the gradient of the planes c - r and c - r - 1. The lattice is swept in tiles,
/// whose planes are as large as the cache allows; a tile works out what its neighbours' windows need of it for itself.
///
/// Every sum is made anew from what is in it: a window that moves on, taking in a row and letting one go, would in T
/// keep a trace of what had been in it. What windows that follow each other have in common is summed once.
///
/// Images of two dimensions are rows that are one plane each.
template <int Dim, class T>
class LocalCorrelation final : public Similarity<Dim, T> {
 public:
  LocalCorrelation(const Lattice<Dim>& lattice, double radius_mm, double floor)
      : shape_{{1, 1, 1}, {0, 0, 0}, lattice.cell_volume(), floor * floor}, sites_(lattice.sites()) {
    for (int i = 0; i < Dim; ++i) {
      const int axis = i == Dim - 1 ? 2 : i;
      shape_.size[axis] = lattice.size[i];
      if (lattice.size[i] < 2) continue;
      const long samples = std::max(1l, std::lround(radius_mm / lattice.spacing[i]));
      shape_.radius[axis] = static_cast<int>(std::min(samples, static_cast<long>(lattice.size[i]) - 1));
    }
  }

  void prepare(const T* fixed, const T* resting, const T* weights) override {
    middles_ = middle_values(sites_, fixed, resting, weights);
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    CorrelationScene<T> scene{fixed, warped, weights, gradient, weight_gradient, T(0), T(0)};
    std::tie(scene.middle_fixed, scene.middle_warped) =
        middles_ ? *middles_ : middle_values(sites_, fixed, warped, weights);
    if (weight_gradient) return sweep<6, 6>(scene);
    return weights ? sweep<6, 3>(scene) : sweep<5, 3>(scene);
  }

 private:
  static constexpr std::size_t kCacheBytes = 700 * 1024;       ///< of a second-level cache, for a tile's planes
  static constexpr int kMostPlanes = 64;                       ///< of a tile
  static constexpr int kMostRegisters = 768 / kRegisterBytes;  ///< of its rows: windows of them fit a first-level cache

  std::vector<CorrelationTile> tiles(std::size_t sums, std::size_t coefficients) const {
    const auto cut = [](int size, int part, int parts) {
      return SiteRange{static_cast<int>(static_cast<long>(size) * part / parts),
                       static_cast<int>(static_cast<long>(size) * (part + 1) / parts)};
    };
    const int width = shape_.size[0], height = shape_.size[1], planes = shape_.size[2];
    constexpr int lanes = static_cast<int>(kRegisterLanes<T>);
    const int registers = (width + lanes - 1) / lanes, strips = (registers + kMostRegisters - 1) / kMostRegisters;
    // Rows that the cache holds: those of the images go beyond a tile by two radii on both sides.
    const std::size_t row = static_cast<std::size_t>((registers + strips - 1) / strips) * kRegisterBytes;
    const std::size_t images = row * (sums - 3) * (shape_.window(2) + 1);
    const std::size_t both = images + row * coefficients * shape_.window(2);
    const long bytes = static_cast<long>(kCacheBytes) - 4 * shape_.radius[1] * static_cast<long>(images);
    const int least = std::max(8, 2 * shape_.radius[1]);  // a tile's own rows are worth those beside it
    const int most =
        static_cast<int>(std::clamp<long>(bytes / static_cast<long>(both), least, std::max(least, (height + 1) / 2)));
    const int bands = (height + most - 1) / most, chunks = (planes + kMostPlanes - 1) / kMostPlanes;
    std::vector<CorrelationTile> tiles;
    for (int chunk = 0; chunk < chunks; ++chunk)
      for (int band = 0; band < bands; ++band)
        for (int strip = 0; strip < strips; ++strip) {
          const SiteRange part = cut(registers, strip, strips);
          tiles.push_back({{part.begin * lanes, std::min(width, part.end * lanes)},
                           cut(height, band, bands),
                           cut(planes, chunk, chunks)});
        }
    return tiles;
  }

  /// Code of their own have the radii along x that RowWindow knows, and the default along all axes.
  template <std::size_t Sums, std::size_t Coefficients>
  double sweep(const CorrelationScene<T>& scene) {
    const std::array<int, 3>& radius = shape_.radius;
    const bool is_same = radius[0] == radius[1] && radius[0] == radius[2];
    switch (radius[0]) {
      case 1:
        return sweep<Sums, Coefficients, 1, -1>(scene);
      case 2:
        return is_same ? sweep<Sums, Coefficients, 2, 2>(scene) : sweep<Sums, Coefficients, 2, -1>(scene);
      case 3:
        return sweep<Sums, Coefficients, 3, -1>(scene);
      case 4:
        return sweep<Sums, Coefficients, 4, -1>(scene);
      default:
        return sweep<Sums, Coefficients, 0, -1>(scene);
    }
  }
  template <std::size_t Sums, std::size_t Coefficients, int Along, int Across>
  double sweep(const CorrelationScene<T>& scene) {
    work_.resize(static_cast<std::size_t>(std::max(omp_get_max_threads(), static_cast<int>(work_.size()))));
    const std::vector<CorrelationTile> all = tiles(Sums, Coefficients);
    std::vector<double> energies(all.size());
#pragma omp parallel for schedule(dynamic, 1)
    for (std::size_t i = 0; i < all.size(); ++i) {
      CorrelationWork<T>& work = work_[static_cast<std::size_t>(omp_get_thread_num())];
      energies[i] = CorrelationSweep<Sums, Coefficients, Along, Across, T>(shape_, scene, all[i], work).run();
    }
    double energy = 0;
    for (double part : energies) energy += part;
    return energy;
  }

  CorrelationShape shape_;
  std::size_t sites_;
  std::optional<std::pair<T, T>> middles_;  ///< of the images, as prepared
  std::vector<CorrelationWork<T>> work_;    ///< by thread
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_local_correlation(const Lattice<Dim>& lattice, double radius_mm,
                                                           double floor) {
  return std::make_unique<LocalCorrelation<Dim, T>>(lattice, radius_mm, floor);
}

template std::unique_ptr<Similarity<2, float>> make_local_correlation(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, float>> make_local_correlation(const Lattice<3>&, double, double);
template std::unique_ptr<Similarity<2, double>> make_local_correlation(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, double>> make_local_correlation(const Lattice<3>&, double, double);

}  // namespace saltus
