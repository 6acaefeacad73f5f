#include "tests/benchmark/kernel_costs.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <memory>
#include <ostream>
#include <string>

#ifdef _OPENMP
#include <omp.h>
#endif

#include "core/flow/backward_map.h"
#include "core/flow/coadjoint_transport.h"
#include "core/grid/resampling.h"
#include "core/grid/warp.h"
#include "core/kernels/kernel_profile.h"
#include "core/kernels/separable_convolution.h"
#include "core/similarity/similarity.h"
#include "core/support/stopwatch.h"
#include "tests/benchmark/machine_limits.h"

namespace saltus::benchmark {
namespace {

constexpr double kVector = 3 * sizeof(float), kScalar = sizeof(float);  ///< bytes of a site

/// A loop over all sites, with what it has to move and to do for each of them.
struct Kernel {
  std::string name;
  double bytes = 0, operations = 0;
  std::function<void()> run;
};

Field<float> smooth(std::size_t sites, int channels, float amount) {
  Field<float> values(sites * static_cast<std::size_t>(channels));
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = amount * std::sin(1e-3f * static_cast<float>(i) + static_cast<float>(i % 3));
  return values;
}

/// Linear interpolation of `channels` values in a cell: seven steps low + t (high - low) of three operations.
constexpr double interpolation(int channels) { return 7 * 3 * channels; }
/// Where a site is now, in samples: a product and a sum an axis.
constexpr double kPlacing = 3 * 2;

class Scene {
 public:
  explicit Scene(int size)
      : lattice_{{size, size, size}, {1, 1, 1}, {}},
        sites_(lattice_.sites()),
        vectors_(smooth(sites_, 3, 1)),
        displacement_(smooth(sites_, 3, 0.8f)),
        out_(3 * sites_),
        dual_(smooth(sites_, 3, 0.1f)),
        fixed_(smooth(sites_, 1, 0.4f)),
        scalar_(sites_) {
    image_.lattice = lattice_;
    const Field<float> samples = smooth(sites_, 1, 0.5f);
    image_.samples.assign(samples.begin(), samples.end());
    image_.linear.setIdentity();
    image_.offset.setZero();
  }

  std::vector<Kernel> kernels() {
    std::vector<Kernel> list;
    const auto pass = [&](const std::string& name, const KernelProfile& profile) {
      const KernelTaps taps = cell_averaged_taps(profile, 1.0);
      auto row = std::make_shared<AxisTaps<float>>(taps.value);
      // The field is read and written once. Two values are added, multiplied by the tap that they share and added to
      // the sum; the middle one is multiplied. Both axes of a plane are done at once and in place, as order 0 has them.
      const double operations = 3 * (3.0 * row->radius() + 1);
      list.push_back({name + ", along z", 2 * kVector, operations, [this, row] {
                        convolve_axis<3, float>(lattice_, 3, 2, *row, Combine::Replace, vectors_.data(), out_.data());
                      }});
      list.push_back({name + ", along y and x", 2 * kVector, 2 * operations, [this, row] {
                        convolve_planes<float>(lattice_, 3, *row, *row, Combine::Replace, out_.data(), out_.data());
                      }});
    };
    pass("synthesis, gaussian of 6 voxels", *make_gaussian_profile(6));
    pass("synthesis, wendland of 6 voxels", *make_wendland_profile(6));

    // Reads where sites are and their momenta; what it adds to is read and written. For each of eight corners a weight
    // (one product, three for all that corners share) and a product and a sum a component.
    auto sites = std::make_shared<MovedSites<3, float>>(lattice_, Evolution::Carried);
    auto transport = std::make_shared<CoadjointTransport<3, float>>(lattice_, 1.0, true, false, Evolution::Carried);
    list.push_back({"push of momenta of order 0", 4 * kVector, kPlacing + 8 * (1 + 2 * 3) + 6, [=, this] {
                      sites->move(displacement_.data());
                      transport->push(*sites, vectors_.data(), nullptr, {}, transport->reached(*sites, {}), out_.data(),
                                      nullptr);
                    }});
    // The same read the other way round, with the gradient of the position.
    list.push_back({"its adjoint", 7 * kVector, kPlacing + interpolation(3) + 3 * interpolation(1), [=, this] {
                      sites->begin_adjoint(BlockMask<3>::all(lattice_));
                      transport->push_adjoint(*sites, vectors_.data(), nullptr, {}, dual_.data(), nullptr, more_.data(),
                                              out_.data(), nullptr);
                      sites->end_adjoint(BlockMask<3>::all(lattice_), more_.data());
                    }});
    more_.assign(3 * sites_, 0);

    // One step back with Heun's rule: position and both velocities read, the position written; two interpolations.
    velocities_.assign(2, vectors_);
    auto map = std::make_shared<BackwardMap<3, float>>(lattice_, lattice_, 1);
    list.push_back({"a step of the backward map", 4 * kVector, 2 * (kPlacing + interpolation(3) + 6),
                    [=, this] { map->follow(velocities_); }});
    // Both velocities, the position and the dual read; the duals of both velocities read and written.
    velocity_duals_.assign(2, Field<float>(3 * sites_, 0));
    list.push_back({"its adjoint", 8 * kVector, 2 * (kPlacing + 8 * 7 + 3 * interpolation(1) + 6),
                    [=, this] { map->adjoint(velocities_, dual_, velocity_duals_); }});

    list.push_back({"warp", kVector + 2 * kScalar, 3 * kPlacing + interpolation(1),
                    [this] { warp<3, float>(image_, lattice_, displacement_.data(), scalar_.data()); }});
    list.push_back({"its adjoint", 2 * kVector + 2 * kScalar, 3 * kPlacing + 3 * interpolation(1) + 9 * 2, [this] {
                      warp_adjoint<3, float>({{&image_, fixed_.data()}}, lattice_, displacement_.data(), more_.data());
                    }});
    // As an optimisation has them: the slopes are written beside the value, and multiplied by the dual later.
    list.push_back({"warp with its slopes", 2 * kVector + 2 * kScalar, 3 * kPlacing + 4 * interpolation(1) + 5 * 3,
                    [this] { warp<3, float>(image_, lattice_, displacement_.data(), scalar_.data(), more_.data()); }});
    list.push_back({"its adjoint from these", 2 * kVector + kScalar, 3,
                    [this] { warp_adjoint<3, float>(fixed_.data(), more_.data(), lattice_, nullptr, out_.data()); }});

    // Every second sample read, all of them read and written; along each axis two products and a sum, of a quarter,
    // half and all of what comes out. Its transpose reads all and writes every second one, with a sum more.
    Lattice<3> coarse = lattice_;
    for (int axis = 0; axis < 3; ++axis)
      coarse.size[axis] /= 2, coarse.spacing[axis] *= 2, coarse.offset[axis] = 0.5 * lattice_.spacing[axis];
    auto between = std::make_shared<LatticeInterpolation<3, float>>(coarse, lattice_, 3);
    constexpr double values = 3 * (1 + 0.5 + 0.25);
    list.push_back({"a field on a lattice twice as fine", (2 + 0.125) * kVector, values * 3,
                    [=, this] { between->add_to(vectors_.data(), out_.data()); }});
    list.push_back({"its transpose", (1 + 0.125) * kVector, values * 4,
                    [=, this] { between->transpose(vectors_.data(), more_.data()); }});

    // Both images read, the gradient written. Windows around each sample: six products, window sums of those and of
    // three coefficients (a sum and a difference along each axis), and about forty operations to make the coefficients
    // and the gradient of them. Windows of cells: at each sample the means of both are taken off, three products are
    // made and five values added to their cell's; later the means again, two products and two sums. For each cell, one
    // for eight samples, window sums of five quantities and three coefficients (two sums and a product along each
    // axis), and about forty operations to make these.
    for (int cell : {1, 2}) {
      similarities_.push_back(
          (cell == 1 ? make_local_correlation<3, float> : make_cell_correlation<3, float>)(lattice_, 2.0, 0.01));
      const double operations =
          cell == 1 ? 6 + (6 + 3) * 3 * 2 + 40 : (2 + 3 + 5 + 2 + 4) + ((5 + 3) * 3 * 3 + 40) / 8.0;
      const std::string name =
          std::string("local correlation, windows ") + (cell == 1 ? "around each sample" : "of cells");
      add_similarity(list, name, 3 * kScalar, operations);
      if (cell == 1) continue;
      // With a mask and the gradient with respect to it: two products and a sum more of each sample, six coefficients,
      // and ten operations more for each gradient.
      weights_.assign(sites_, 1);
      Similarity<3, float>* similarity = similarities_.back().get();
      list.push_back(
          {name + ", with a mask", 5 * kScalar, (2 + 3 + 5 + 3 + 2 + 5 + 10) + ((6 + 6) * 3 * 3 + 70) / 8.0, [=, this] {
             similarity->evaluate(fixed_.data(), image_.samples.data(), weights_.data(), scalar_.data(), more_.data());
           }});
    }

    // Per axis and image a difference and its scale; per axis three products and sums; three quotients and seven more
    // operations for the value and for what its gradient shares; per axis three for a dual and three to collect them.
    similarities_.push_back(make_gradient_fields<3, float>(lattice_, 0));
    add_similarity(list, "gradient fields", 3 * kScalar, 3 * (2 * 2 + 3 * 2 + 3 + 3) + 3 + 7);
    // Beside the warped image the twelve descriptors of the fixed one are read. For each of six directions: a
    // difference, its square and scale, a window sum (two operations along each axis); on the way back two duals added
    // and scaled, a window sum, and for both samples of a difference a product, added. For each of twelve pairs: its
    // part of the mean, its quotient by that, an exponential (its argument bounded and taken apart, a power series of
    // seven products and sums), the difference to the other's, its square and sum, and five operations for its dual.
    // Five for the mean and its inverse, and for what their dual shares.
    similarities_.push_back(make_self_similarity<3, float>(lattice_, 1.0, 1.0));
    add_similarity(list, "self-similarity", (2 + 12) * kScalar,
                   6 * ((3 + 6) + (2 + 6 + 2 * 2)) + 12 * (1 + 1 + (9 + 7 * 2) + 3 + 5) + 5);
    return list;
  }

  std::size_t sites() const { return sites_; }

 private:
  /// An evaluation of the last of the similarities, without masks.
  void add_similarity(std::vector<Kernel>& list, const std::string& name, double bytes, double operations) {
    Similarity<3, float>* similarity = similarities_.back().get();
    similarity->prepare(fixed_.data(), image_.samples.data(), nullptr);
    list.push_back({name, bytes, operations, [=, this] {
                      similarity->evaluate(fixed_.data(), image_.samples.data(), nullptr, scalar_.data(), nullptr);
                    }});
  }

  Lattice<3> lattice_;
  std::size_t sites_;
  Field<float> vectors_, displacement_, out_, dual_, fixed_, scalar_, more_, weights_;
  FramedImage<3, float> image_;
  std::vector<Field<float>> velocities_, velocity_duals_;
  std::vector<std::unique_ptr<Similarity<3, float>>> similarities_;
};

void use_threads([[maybe_unused]] int count) {
#ifdef _OPENMP
  omp_set_num_threads(count);
#endif
}

/// Processor seconds of all threads so far, asked of each: a process that asks for its own learns of the other ones
/// only now and then what they have used.
double team_seconds() {
  double seconds = 0;
#pragma omp parallel reduction(+ : seconds)
  {
    timespec used{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
    seconds += static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
  }
  return seconds;
}

}  // namespace

std::vector<Row> kernel_rows(bool is_quick, std::ostream& progress) {
  Scene scene(is_quick ? 48 : 128);
  const int repetitions = is_quick ? 3 : 15;
  LimitMeter meter;
  MachineLimits limits[2];  // of all runs together
  std::vector<Row> rows;
  for (const Kernel& kernel : scene.kernels()) {
    double seconds[2], processor_seconds[2];
    MachineLimits beside[2];  // measured between the runs of this loop
    for (int threads : {1, 2}) {
      use_threads(threads);
      double best = 1e300, best_processor = 1e300;
      for (int repetition = 0; repetition <= repetitions; ++repetition) {
        beside[threads - 1].raise(meter.measure());
        kernel.run();  // what the meter has put out of the caches comes back
        const double used_before = team_seconds();
        const Stopwatch watch;
        kernel.run();
        const double wall = watch.seconds(), used = team_seconds() - used_before;
        if (repetition == 0) continue;  // warms up
        // Of one thread the processor's time: a machine that does other things disturbs it less.
        best_processor = std::min(best_processor, used);
        best = threads == 1 ? best_processor : std::min(best, wall);
      }
      processor_seconds[threads - 1] = best_processor;
      seconds[threads - 1] = best;
      limits[threads - 1].raise(beside[threads - 1]);
    }
    const double sites = static_cast<double>(scene.sites());
    const auto bound = [&](int threads) {
      const MachineLimits& limit = beside[threads - 1];
      return sites *
             std::max(1e-9 * kernel.bytes / limit.gigabytes_per_second, 1e-9 * kernel.operations / limit.gigaflops);
    };
    Row row;
    row.name = kernel.name;
    row.add("bytes", kernel.bytes);
    row.add("operations", kernel.operations);
    row.add("ns", 1e9 * seconds[0] / sites);
    row.add("gigabytes_per_second", 1e-9 * kernel.bytes * sites / seconds[0]);
    row.add("gigaflops", 1e-9 * kernel.operations * sites / seconds[0]);
    row.add("bound_percent", 100 * bound(1) / seconds[0]);
    row.add("bound_percent_two", 100 * bound(2) / seconds[1]);
    row.add("speedup", seconds[0] / seconds[1]);
    row.add("work_speedup", 2 * processor_seconds[0] / processor_seconds[1]);
    row.outcome = 1e-9 * kernel.bytes / beside[0].gigabytes_per_second > 1e-9 * kernel.operations / beside[0].gigaflops
                      ? "memory"
                      : "arithmetic";
    rows.push_back(std::move(row));
    progress << rows.back().name << std::endl;
  }
  for (int threads : {1, 2}) {
    Row row;
    row.name = "the machine, " + std::to_string(threads) + (threads == 1 ? " thread" : " threads");
    row.add("gigabytes_per_second", limits[threads - 1].gigabytes_per_second);
    row.add("gigaflops", limits[threads - 1].gigaflops);
    rows.push_back(std::move(row));
  }
  use_threads(1);
  return rows;
}

std::vector<Column> kernel_columns() {
  return {{"bytes", "bytes a site", 0},
          {"operations", "operations", 0},
          {"ns", "ns a site", 2},
          {"gigabytes_per_second", "GB/s", 1},
          {"gigaflops", "Gflop/s", 1},
          {"bound_percent", "of the bound, %", 0},
          {"bound_percent_two", "with 2 threads, %", 0},
          {"speedup", "2 threads, times faster", 2},
          {"work_speedup", "by processor time", 2}};
}

}  // namespace saltus::benchmark
