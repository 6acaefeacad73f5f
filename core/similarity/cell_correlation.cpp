#include "core/similarity/cell_sweep.h"
#include "core/similarity/middle_values.h"
#include "core/similarity/similarity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include <omp.h>

namespace saltus {
namespace {

/// Windows are made of cells, see cell_window, and move by a cell: with cells of two samples there is one for up
/// to eight (3-D). It counts for all that are in its middle cell.
///
/// The derivative at sample y collects the windows x that hold y, each as often as the weight of its middle cell. It is
/// box sums of coefficients that depend on x alone (WindowCorrelation). Nothing of this sees a constant that is taken
/// off an image; both lose about their mean first, because sums are made in T and a variance small against the mean
/// would be lost in them.
///
/// One sweep along the last axis ("planes") does it all, so that memory sees both images and the gradient and little
/// else: a plane of cells is taken in, which gives its sums along y; of 2 r + 1 such planes windows and their
/// coefficients are made, those summed along x and y; and of 2 r + 1 planes of these the gradient at the samples. The
/// lattice is swept in tiles of whole rows, whose planes are as large as a cache allows; a tile works out what its
/// neighbours' windows need of it for itself.
///
/// Every sum is made anew from what is in it, in the same order whatever the tile: a window that moves on, taking in a
/// row and letting one go, would in T keep a trace of what had been in it.
///
/// Images of two dimensions are rows that are one plane each.
template <int Dim, class T>
class CellCorrelation final : public Similarity<Dim, T> {
 public:
  CellCorrelation(const Lattice<Dim>& lattice, double radius_mm, double floor)
      : shape_{{1, 1, 1}, {{{1, 0}, {1, 0}, {1, 0}}}, lattice.cell_volume(), floor * floor}, sites_(lattice.sites()) {
    for (int i = 0; i < Dim; ++i) {
      const std::size_t axis = i == Dim - 1 ? 2 : static_cast<std::size_t>(i);
      shape_.size[axis] = lattice.size[i];
      if (lattice.size[i] < 2) continue;
      shape_.windows[axis] = cell_window(radius_mm / lattice.spacing[i]);
      int& radius = shape_.windows[axis].radius;
      radius = std::min(radius, shape_.cells(static_cast<int>(axis)));  // more there are not on one side
    }
  }

  void prepare(const T* fixed, const T* resting, const T* weights) override {
    middles_ = middle_values(sites_, fixed, resting, weights);
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    CellScene<T> scene{fixed, warped, weights, gradient, weight_gradient, T(0), T(0)};
    std::tie(scene.middle_fixed, scene.middle_warped) =
        middles_ ? *middles_ : middle_values(sites_, fixed, warped, weights);
    if (weight_gradient) return sweep<6, 6>(scene);
    return weights ? sweep<6, 3>(scene) : sweep<5, 3>(scene);
  }

 private:
  static constexpr std::size_t kCacheBytes = 512 * 1024;  ///< of a second-level cache, for a tile's planes

  /// Bands of rows, as high as the cache allows, and of each as many chunks of planes as keep all threads busy. Sums do
  /// not tell where chunks end, and energies are put together band by band.
  std::vector<CellTile> tiles(std::size_t sums, std::size_t coefficients) const {
    const auto cut = [](int size, int part, int parts) {
      return SiteRange{static_cast<int>(static_cast<long>(size) * part / parts),
                       static_cast<int>(static_cast<long>(size) * (part + 1) / parts)};
    };
    // Of a row of cells: what CellWork keeps, and both images until their gradient has been found.
    const auto window = static_cast<std::size_t>(shape_.window(2)),
               samples = static_cast<std::size_t>(shape_.cell(0) * shape_.cell(1) * shape_.cell(2)),
               values = (sums + coefficients) * (window + 1) + 2 * samples * window;
    const std::size_t bytes = static_cast<std::size_t>(shape_.cells(0)) * sizeof(T) * values;
    const int rows = shape_.cells(1), planes = shape_.cells(2), threads = omp_get_max_threads();
    const int least = std::max(8, 4 * shape_.radius(1));  // a tile's own rows are worth those beside it
    const int most = static_cast<int>(std::clamp<std::size_t>(kCacheBytes / bytes, static_cast<std::size_t>(least),
                                                              static_cast<std::size_t>(std::max(least, rows))));
    const int bands = (rows + most - 1) / most;
    const bool is_busy = threads == 1 || bands >= 4 * threads;
    const int chunks = is_busy ? 1 : std::clamp(planes / (8 * shape_.window(2)), 1, 2 * threads);
    std::vector<CellTile> tiles;
    for (int band = 0; band < bands; ++band)
      for (int chunk = 0; chunk < chunks; ++chunk)
        tiles.push_back({cut(rows, band, bands), cut(planes, chunk, chunks), band});
    return tiles;
  }

  /// Code of their own have the cells and radii along x of small windows.
  template <std::size_t Sums, std::size_t Coefficients>
  double sweep(const CellScene<T>& scene) {
    const int radius = shape_.radius(0);
    if (shape_.cell(0) == 1)
      return radius == 1 ? sweep<Sums, Coefficients, 1, 1>(scene) : sweep<Sums, Coefficients, 1, 0>(scene);
    return radius == 1   ? sweep<Sums, Coefficients, 2, 1>(scene)
           : radius == 2 ? sweep<Sums, Coefficients, 2, 2>(scene)
                         : sweep<Sums, Coefficients, 2, 0>(scene);
  }
  template <std::size_t Sums, std::size_t Coefficients, int Cell, int Along>
  double sweep(const CellScene<T>& scene) {
    work_.resize(static_cast<std::size_t>(std::max(omp_get_max_threads(), static_cast<int>(work_.size()))));
    const std::vector<CellTile> all = tiles(Sums, Coefficients);
    const auto planes = static_cast<std::size_t>(shape_.cells(2));
    std::vector<double> energies(planes * static_cast<std::size_t>(all.back().band + 1));
#pragma omp parallel for schedule(dynamic, 1)
    for (std::size_t i = 0; i < all.size(); ++i) {
      CellWork<T>& work = work_[static_cast<std::size_t>(omp_get_thread_num())];
      CellSweep<Sums, Coefficients, Cell, Along, T>(shape_, scene, all[i], work)
          .run(energies.data() + planes * static_cast<std::size_t>(all[i].band) +
               static_cast<std::size_t>(all[i].planes.begin));
    }
    double energy = 0;
    for (double part : energies) energy += part;
    return energy;
  }

  CellShape shape_;
  std::size_t sites_;
  std::optional<std::pair<T, T>> middles_;  ///< of the images, as prepared
  std::vector<CellWork<T>> work_;           ///< by thread
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_cell_correlation(const Lattice<Dim>& lattice, double radius_mm, double floor) {
  return std::make_unique<CellCorrelation<Dim, T>>(lattice, radius_mm, floor);
}

template std::unique_ptr<Similarity<2, float>> make_cell_correlation(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, float>> make_cell_correlation(const Lattice<3>&, double, double);
template std::unique_ptr<Similarity<2, double>> make_cell_correlation(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, double>> make_cell_correlation(const Lattice<3>&, double, double);

}  // namespace saltus
