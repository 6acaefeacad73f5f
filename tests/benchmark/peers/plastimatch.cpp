#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "tests/benchmark/peers/methods.h"

namespace saltus::benchmark {
namespace {

constexpr int kSlices = 4;  ///< that a 2-D image becomes: the least that the program takes

/// The same slice several times, 1 mm apart.
Volume<3> slab(const Volume<2>& image) {
  ImageGrid<3> grid;
  grid.size = {image.grid.size[0], image.grid.size[1], kSlices};
  grid.spacing = {image.grid.spacing[0], image.grid.spacing[1], 1};
  grid.origin = {image.grid.origin[0], image.grid.origin[1], 0};
  grid.direction = Matrix<3>::Identity();
  grid.direction.topLeftCorner<2, 2>() = image.grid.direction;
  Volume<3> volume(grid);
  for (int slice = 0; slice < kSlices; ++slice)
    std::copy(image.samples.begin(), image.samples.end(),
              volume.samples.begin() + static_cast<std::ptrdiff_t>(slice * image.samples.size()));
  return volume;
}

/// One of the middle slices, without what is across it.
void write_slice(const std::filesystem::path& from, const ImageGrid<2>& grid, const std::filesystem::path& to,
                 bool is_field) {
  const std::size_t pixels = grid.voxels(), first = kSlices / 2 * pixels;
  if (is_field) {
    const VectorVolume<3> field = read_vector_volume<3>(from);
    VectorVolume<2> slice(grid);
    for (int c = 0; c < 2; ++c) std::copy_n(field.component(c) + first, pixels, slice.component(c));
    write_vector_volume<2>(to, slice);
  } else {
    const Volume<3> image = read_volume<3>(from);
    Volume<2> slice(grid);
    std::copy_n(image.samples.begin() + static_cast<std::ptrdiff_t>(first), pixels, slice.samples.begin());
    write_volume<2>(to, slice);
  }
}

std::vector<double> spacing_of(const PeerPair& pair) {
  if (pair.dimension == 2) {
    const Vector<2> spacing = read_grid<2>(pair.fixed).spacing;
    return {spacing[0], spacing[1], 1};
  }
  const Vector<3> spacing = read_grid<3>(pair.fixed).spacing;
  return {spacing[0], spacing[1], spacing[2]};
}

class Plastimatch final : public Method {
 public:
  Plastimatch(std::filesystem::path program, std::string smoothness)
      : program_(std::move(program)), smoothness_(std::move(smoothness)) {}

  std::string family() const override { return "plastimatch"; }
  std::string choice() const override { return "lambda " + smoothness_; }
  std::string setting(const PeerPair& pair, int threads) const override {
    return "plastimatch, " + std::to_string(threads) + " threads\n" +
           plastimatch_parameters(pair, smoothness_, spacing_of(pair), "fixed", "moving", "");
  }

  MethodRun run(const PeerPair& pair, int threads, const std::filesystem::path& folder) const override {
    std::filesystem::path fixed = pair.fixed, moving = pair.moving;
    if (pair.dimension == 2) {
      fixed = folder / "fixed_slab.mha";
      moving = folder / "moving_slab.mha";
      write_volume<3>(fixed, slab(read_volume<2>(pair.fixed)));
      write_volume<3>(moving, slab(read_volume<2>(pair.moving)));
    }
    const std::filesystem::path parameters = folder / "parameters.txt", log = folder / "output.txt";
    std::ofstream(parameters) << plastimatch_parameters(pair, smoothness_, spacing_of(pair), fixed, moving, folder);
    MethodRun result;
    result.cost = run_measured({program_, "register", parameters},
                               {{"OMP_NUM_THREADS", std::to_string(threads)}, {"OMP_WAIT_POLICY", "passive"}}, log);
    result.displacement = folder / "field.mha";
    result.warped = folder / "warped.mha";
    if (result.cost.exit_code != 0 || !std::filesystem::exists(result.displacement))
      throw std::runtime_error(program_.string() + " ended with exit code " + std::to_string(result.cost.exit_code) +
                               ", see " + log.string());
    if (pair.dimension == 2) {
      const ImageGrid<2> grid = read_grid<2>(pair.fixed);
      write_slice(result.displacement, grid, folder / "field_slice.mha", true);
      write_slice(result.warped, grid, folder / "warped_slice.mha", false);
      result.displacement = folder / "field_slice.mha";
      result.warped = folder / "warped_slice.mha";
    }
    return result;
  }

 private:
  std::filesystem::path program_;
  std::string smoothness_;
};

}  // namespace

std::string plastimatch_parameters(const PeerPair& pair, const std::string& smoothness,
                                   const std::vector<double>& spacing, const std::filesystem::path& fixed,
                                   const std::filesystem::path& moving, const std::filesystem::path& folder) {
  std::ostringstream out;
  out << "[GLOBAL]\nfixed=" << fixed.string() << "\nmoving=" << moving.string()
      << "\nvf_out=" << (folder / "field.mha").string() << "\nimg_out=" << (folder / "warped.mha").string()
      << "\nimg_out_type=float\n";
  const double finest = *std::min_element(spacing.begin(), spacing.end() - (pair.dimension == 2 ? 1 : 0));
  for (int coarsening : {4, 2, 1}) {
    out << "\n[STAGE]\n";
    if (coarsening == 4)
      out << "xform=bspline\nimpl=plastimatch\nthreading=openmp\n"
          << "optim=lbfgsb\nmetric=mse\nregularization_lambda=" << smoothness << '\n';
    out << "max_its=" << (pair.dimension == 2 ? 100 : 50) << "\ngrid_spac=";
    for (int axis = 0; axis < 3; ++axis) out << (axis ? " " : "") << coarsening * pair.grid_mm;
    // Axes of coarse voxels are not made coarser before the others are.
    out << "\nres=";
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_across = pair.dimension == 2 && axis == 2;
      const double factor = std::floor(coarsening * finest / spacing[static_cast<std::size_t>(axis)] + 1e-6);
      out << (axis ? " " : "") << (is_across ? 1 : std::max(1, static_cast<int>(factor)));
    }
    out << '\n';
  }
  return out.str();
}

std::unique_ptr<Method> make_plastimatch(const std::filesystem::path& program, const std::string& smoothness) {
  return std::make_unique<Plastimatch>(program, smoothness);
}

}  // namespace saltus::benchmark
