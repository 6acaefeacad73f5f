#include "core/slip/jump_density.h"

#include "core/grid/interpolation.h"
#include "core/kernels/separable_convolution.h"
#include "core/support/errors.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <utility>

namespace saltus {
namespace {

constexpr double kCut = 4;           // of the Gaussian, in standard deviations
constexpr double kAcrossStep = 0.5;  // of the smoothing
constexpr std::size_t kElementsAtOnce = 64;
constexpr std::size_t kSamplesAtOnce = 1 << 20;  // of the boxes of those, but for one that has more by itself

template <int Dim>
Lattice<Dim> finest_with_elements(const std::vector<JumpElements<Dim>>& elements) {
  const Lattice<Dim>* finest = nullptr;
  for (const JumpElements<Dim>& scale : elements)
    if (!scale.list.empty() && (!finest || scale.lattice.cell_volume() < finest->cell_volume()))
      finest = &scale.lattice;
  if (!finest)
    throw InvalidInput("a density of jumps was asked for, and no momentum makes one; ask for it where one does");
  return *finest;
}

/// Adds value times a hat as wide as two cells of `from`, which sums to 1, to the samples around `place`; there are
/// `Channels` values a sample. One after the other, with memory that is used again.
template <int Dim, int Channels>
class HatAdder {
 public:
  HatAdder(const Lattice<Dim>& lattice, const Lattice<Dim>& from) : lattice_(lattice), from_(from) {}

  void operator()(const Vector<Dim>& place, const Eigen::Matrix<double, Channels, 1>& value, float* values) {
    Lattice<Dim> patch;  // of what it covers that which the lattice has
    Index<Dim> skipped;  // of its samples, along each axis
    std::size_t corner = 0;
    std::array<std::size_t, Dim> strides;
    for (int a = 0; a < Dim; ++a) {
      const double h = lattice_.spacing[a], half = std::max(from_.spacing[a], h);
      const int begin = static_cast<int>(std::ceil((place[a] - half - lattice_.offset[a]) / h));
      const int end = static_cast<int>(std::floor((place[a] + half - lattice_.offset[a]) / h));
      double sum = 0;
      weights_[a].clear();
      for (int i = begin; i <= end; ++i) {
        weights_[a].push_back(std::max(0.0, 1 - std::abs(lattice_.offset[a] + i * h - place[a]) / half));
        sum += weights_[a].back();
      }
      for (double& weight : weights_[a]) weight /= sum * h;
      const int first = std::max(0, begin), last = std::min(lattice_.size[a] - 1, end);
      if (first > last) return;
      patch.size[a] = last - first + 1;
      skipped[a] = first - begin;
      strides[a] = a == 0 ? 1 : strides[a - 1] * static_cast<std::size_t>(lattice_.size[a - 1]);
      corner += strides[a] * static_cast<std::size_t>(first);
    }
    for (int slab = 0; slab < patch.size[Dim - 1]; ++slab)
      visit_slab<Dim>(patch, slab, [&](const Index<Dim>& index, std::size_t) {
        double weight = 1;
        std::size_t site = corner;
        for (int a = 0; a < Dim; ++a) {
          weight *= weights_[a][static_cast<std::size_t>(skipped[a] + index[a])];
          site += strides[a] * static_cast<std::size_t>(index[a]);
        }
        float* sum = values + Channels * site;
        for (int c = 0; c < Channels; ++c) sum[c] += static_cast<float>(weight * value[c]);
      });
  }

 private:
  const Lattice<Dim>&lattice_, &from_;
  std::array<std::vector<double>, Dim> weights_;
};

/// Two unit vectors, or one, that span the plane with this normal: the frame's axes where those lie in it.
template <int Dim>
std::array<Vector<Dim>, Dim - 1> plane_axes(const Vector<Dim>& normal) {
  if constexpr (Dim == 2) {
    return {Vector<2>(-normal[1], normal[0])};
  } else {
    Eigen::Index least = 0;
    normal.cwiseAbs().minCoeff(&least);
    const Vector<3> first = normal.cross(Vector<3>::Unit(least)).normalized();
    return {first, normal.cross(first)};
  }
}

/// k0 at whole multiples of about a sample of `lattice` along `axis`, with sum 1, and those places.
template <int Dim>
std::vector<std::pair<double, double>> lateral_weights(const Lattice<Dim>& lattice, const Vector<Dim>& axis,
                                                       double width) {
  const double step = cell_along<Dim>(lattice, axis);
  const int count = static_cast<int>(width / step);
  std::vector<std::pair<double, double>> weights;
  double sum = 0;
  for (int k = -count; k <= count; ++k) {
    weights.emplace_back(k * step, std::pow(1 - std::abs(k) * step / width, 2));
    sum += weights.back().second;
  }
  for (auto& [place, weight] : weights) weight /= sum;
  return weights;
}

/// The samples of `lattice` that the hats of an element reach, as a lattice of their own; one without any where there
/// are none.
template <int Dim>
Lattice<Dim> covered_by(const Lattice<Dim>& lattice, const JumpElements<Dim>& of, const Vector<Dim>& at,
                        const std::array<Vector<Dim>, Dim - 1>& axes, Index<Dim>& low) {
  Lattice<Dim> box = lattice;
  for (int a = 0; a < Dim; ++a) {
    double reach = std::max(of.lattice.spacing[a], lattice.spacing[a]);
    for (const Vector<Dim>& axis : axes) reach += std::abs(axis[a]) * of.widest_mm();
    const double middle = (at[a] - lattice.offset[a]) / lattice.spacing[a], samples = reach / lattice.spacing[a];
    low[a] = std::max(0, static_cast<int>(std::floor(middle - samples)));
    const int high = std::min(lattice.size[a] - 1, static_cast<int>(std::ceil(middle + samples)));
    box.size[a] = std::max(0, high - low[a] + 1);
    box.offset[a] = lattice.offset[a] + low[a] * lattice.spacing[a];
  }
  return box;
}

/// How much of an element there is at each sample that its hats reach, over the plane that it covers.
template <int Dim>
struct ElementShare {
  Index<Dim> low;    ///< of the box, in samples of the lattice
  Lattice<Dim> box;  ///< without samples where the lattice has none that are reached
  std::vector<float> values;

  void find(const Lattice<Dim>& lattice, const JumpElements<Dim>& of, const JumpElement<Dim>& element) {
    const auto axes = plane_axes<Dim>(element.normal);
    box = covered_by<Dim>(lattice, of, element.at, axes, low);
    values.assign(box.sites(), 0.0f);
    if (values.empty()) return;
    HatAdder<Dim, 1> add(box, of.lattice);
    const auto add_at = [&](const Vector<Dim>& at, double weight) {
      add(at, Eigen::Matrix<double, 1, 1>(weight), values.data());
    };
    for (const JumpSpread& spread : of.spreads) {
      const auto along = lateral_weights<Dim>(of.lattice, axes[0], spread.width_mm);
      if constexpr (Dim == 2) {
        for (const auto& [place, weight] : along) add_at(element.at + place * axes[0], spread.share * weight);
      } else {
        const auto across = lateral_weights<Dim>(of.lattice, axes[1], spread.width_mm);
        for (const auto& [first, weight] : along)
          for (const auto& [second, other] : across)
            add_at(element.at + first * axes[0] + second * axes[1], spread.share * weight * other);
      }
    }
  }

  /// All values of its jump, to one slab of the lattice.
  void add_slab(const Lattice<Dim>& lattice, const JumpElement<Dim>& element, int slab, float* sums) const {
    const int in_box_slab = slab - low[Dim - 1];
    if (values.empty() || in_box_slab < 0 || in_box_slab >= box.size[Dim - 1]) return;
    Eigen::Matrix<float, Dim * Dim, 1> tensor;
    for (int c = 0; c < Dim; ++c)
      for (int a = 0; a < Dim; ++a) tensor[Dim * c + a] = static_cast<float>(element.strength[c] * element.normal[a]);
    visit_slab<Dim>(box, in_box_slab, [&](const Index<Dim>& index, std::size_t in_box) {
      if (values[in_box] == 0) return;
      std::size_t site = 0;
      for (int a = Dim - 1; a >= 0; --a)
        site = site * static_cast<std::size_t>(lattice.size[a]) + static_cast<std::size_t>(low[a] + index[a]);
      float* sum = sums + Dim * Dim * site;
      for (int c = 0; c < Dim * Dim; ++c) sum[c] += values[in_box] * tensor[c];
    });
  }
};

/// So many that their boxes, however the planes are turned, hold no more than kSamplesAtOnce.
template <int Dim>
std::size_t elements_at_once(const Lattice<Dim>& lattice, const JumpElements<Dim>& of) {
  double most = 1;
  for (int a = 0; a < Dim; ++a) {
    const double reach = std::max(of.lattice.spacing[a], lattice.spacing[a]) + std::sqrt(Dim - 1.0) * of.widest_mm();
    most *= std::min<double>(lattice.size[a], 2 * reach / lattice.spacing[a] + 3);
  }
  return std::clamp<std::size_t>(static_cast<std::size_t>(static_cast<double>(kSamplesAtOnce) / most), 1,
                                 kElementsAtOnce);
}

/// Adds elements one by one, some at a time: threads share out elements, then slabs of the lattice, each of which gets
/// what it gets in the same order with any number of threads.
template <int Dim>
void add_one_by_one(const Lattice<Dim>& lattice, const JumpElements<Dim>& of, float* values) {
  const std::size_t at_once = elements_at_once<Dim>(lattice, of);
  std::vector<ElementShare<Dim>> shares(std::min(at_once, of.list.size()));
  for (std::size_t begin = 0; begin < of.list.size(); begin += at_once) {
    const std::size_t count = std::min(at_once, of.list.size() - begin);
#pragma omp parallel
    {
#pragma omp for schedule(dynamic)
      for (std::size_t k = 0; k < count; ++k) shares[k].find(lattice, of, of.list[begin + k]);
#pragma omp for schedule(dynamic)
      for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
        for (std::size_t k = 0; k < count; ++k) shares[k].add_slab(lattice, of.list[begin + k], slab, values);
    }
  }
}

/// Adds elements whose normal is one axis: their planes are those of the lattice, and there may be as many of them as
/// sites, so kernels are rows along the other axes.
template <int Dim>
void add_along_axis(const Lattice<Dim>& lattice, const JumpElements<Dim>& elements, float* values) {
  std::vector<float> jumps(Dim * lattice.sites()), next(jumps.size());
  HatAdder<Dim, Dim> add(lattice, elements.lattice);
  for (const JumpSpread& spread : elements.spreads) {
    std::fill(jumps.begin(), jumps.end(), 0.0f);
    for (const JumpElement<Dim>& element : elements.list)
      add(element.at, spread.share * element.strength, jumps.data());
    for (int axis = 0; axis < Dim; ++axis) {
      if (axis == elements.axis) continue;
      std::vector<double> taps;
      for (const auto& [place, weight] : lateral_weights<Dim>(lattice, Vector<Dim>::Unit(axis), spread.width_mm))
        taps.push_back(weight);
      convolve_axis<Dim, float>(lattice, Dim, axis, AxisTaps<float>(taps), Combine::Replace, jumps.data(), next.data());
      std::swap(jumps, next);
    }
    for (std::size_t site = 0; site < lattice.sites(); ++site)
      for (int c = 0; c < Dim; ++c)
        values[Dim * Dim * site + static_cast<std::size_t>(Dim * c + elements.axis)] += jumps[Dim * site + c];
  }
}

}  // namespace

template <int Dim>
JumpDensity<Dim>::JumpDensity(const std::vector<JumpElements<Dim>>& elements)
    : lattice_(finest_with_elements(elements)) {
  const int radius = static_cast<int>(std::ceil(kCut * kSmoothing));
  const Lattice<Dim> whole = lattice_;
  for (int a = 0; a < Dim; ++a) {
    double low = whole.size[a] - 1, high = 0;
    for (const JumpElements<Dim>& scale : elements)
      for (const JumpElement<Dim>& element : scale.list) {
        const double at = (element.at[a] - whole.offset[a]) / whole.spacing[a];
        const double reach = radius + (scale.widest_mm() + scale.lattice.spacing[a]) / whole.spacing[a];
        low = std::min(low, at - reach);
        high = std::max(high, at + reach);
      }
    const int begin = std::max(0, static_cast<int>(std::floor(low)));
    const int end = std::min(whole.size[a], static_cast<int>(std::ceil(high)) + 1);
    lattice_.size[a] = end - begin;
    lattice_.offset[a] = whole.offset[a] + begin * whole.spacing[a];
  }
  values_.assign(Dim * Dim * lattice_.sites(), 0.0f);
  for (const JumpElements<Dim>& scale : elements) {
    if (scale.axis >= 0 && !scale.list.empty())
      add_along_axis(lattice_, scale, values_.data());
    else
      add_one_by_one(lattice_, scale, values_.data());
  }

  std::vector<double> weights(2 * static_cast<std::size_t>(radius) + 1);
  double sum = 0;
  for (int t = -radius; t <= radius; ++t) sum += std::exp(-t * t / (2 * kSmoothing * kSmoothing));
  for (int t = -radius; t <= radius; ++t)
    weights[static_cast<std::size_t>(t + radius)] = std::exp(-t * t / (2 * kSmoothing * kSmoothing)) / sum;
  const AxisTaps<float> taps(weights);
  std::vector<float> smoothed(values_.size());
  for (int axis = 0; axis < Dim; ++axis) {
    convolve_axis<Dim, float>(lattice_, Dim * Dim, axis, taps, Combine::Replace, values_.data(), smoothed.data());
    std::swap(values_, smoothed);
  }
}

template <int Dim>
double JumpDensity<Dim>::smoothing_along(const Vector<Dim>& direction) const {
  return kSmoothing * cell_along<Dim>(lattice_, direction);
}

template <int Dim>
Vector<Dim> JumpDensity<Dim>::jump_across(const Vector<Dim>& x, const Vector<Dim>& n) const {
  const double step = kAcrossStep * smoothing_along(n);
  const int count = static_cast<int>(std::lround(kCut / kAcrossStep));
  Vector<Dim> sum = Vector<Dim>::Zero();
  for (int k = -count; k <= count; ++k) {
    std::array<double, Dim> at;
    bool is_inside = true;
    for (int a = 0; a < Dim; ++a) {
      at[a] = (x[a] + k * step * n[a] - lattice_.offset[a]) / lattice_.spacing[a];
      is_inside = is_inside && at[a] > -1 && at[a] < lattice_.size[a];
    }
    if (!is_inside) continue;
    const LinearCell<Dim, double> cell(lattice_, at);
    for (int bits = 0; bits < LinearCell<Dim, double>::corners; ++bits) {
      const float* tensor = values_.data() + Dim * Dim * cell.corner(bits);
      for (int c = 0; c < Dim; ++c)
        for (int a = 0; a < Dim; ++a) sum[c] += cell.weight(bits) * step * tensor[Dim * c + a] * n[a];
    }
  }
  return sum;
}

template class JumpDensity<2>;
template class JumpDensity<3>;

}  // namespace saltus
