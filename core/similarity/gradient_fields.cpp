#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/grid/noise.h"
#include "core/similarity/row_pieces.h"
#include "core/similarity/similarity.h"
#include "core/support/reduction.h"

namespace saltus {
namespace {

/// With G = grad I / edge of each image, N = <G_f, G_w>, A = |G_f|^2 + 1 and B = |G_w|^2 + 1, E = V sum of
/// weight (1 - N^2 / (A B)). With
///     dE/dG_w = -2 V weight N / (A B) (G_f - N / B G_w)     (and f alike),
/// sample y collects from its own difference quotients and from those of its neighbours, on each axis:
///     grad I(y) = [ weight(y+1) (I(y+1) - I(y)) + weight(y-1) (I(y) - I(y-1)) ] / (2 h).
/// All this goes along rows, in lanes: pieces of them, so that what lies between two loops stays in the nearest cache.
template <int Dim, class T>
class GradientFields final : public Similarity<Dim, T> {
 public:
  GradientFields(const Lattice<Dim>& lattice, double edge) : lattice_(lattice), given_edge_(edge) {}

  void prepare(const T* fixed, const T* resting, const T* weights) override {
    double f = edge_of(fixed, weights), w = edge_of(resting, weights);
    // An image without any edge takes the other's measure; without any edge at all every measure will do.
    if (f == 0) f = w > 0 ? w : 1;
    if (w == 0) w = f;
    fixed_edge_ = f;
    warped_edge_ = w;
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    if (fixed_edge_ == 0) throw std::logic_error("normalised gradient fields are evaluated before prepare");
    warped_duals_.resize(Dim * lattice_.sites());
    if (weight_gradient) fixed_duals_.resize(Dim * lattice_.sites());
    const double energy = sum_of_pieces(
        lattice_, [&](const Piece& piece) { return compare(piece, fixed, warped, weights, weight_gradient); });
    sum_of_pieces(lattice_, [&](const Piece& piece) {
      collect(piece, warped, weights, warped_duals_.data(), warped_edge_, gradient, weight_gradient);
      if (weight_gradient) collect(piece, fixed, weights, fixed_duals_.data(), fixed_edge_, nullptr, weight_gradient);
      return 0.0;
    });
    return energy;
  }

 private:
  using Piece = RowPiece<Dim>;
  /// A value for each sample of a piece and each axis.
  using Arrows = T[Dim][kLongestPiece];

  /// visit(i, up, down) for the samples of a piece: how far the neighbours of sample i along the axis are, 0 beyond the
  /// border. Those in the middle in lanes.
  template <class Visit>
  [[gnu::always_inline]] void along(int axis, const Piece& piece, Visit&& visit) const {
    const int last = piece.length - 1;
    std::ptrdiff_t stride = 1;
    for (int a = 0; a < axis; ++a) stride *= lattice_.size[a];
    const int begin = piece.first[axis], end = axis == 0 ? begin + last : begin;
    const std::ptrdiff_t up = end + 1 < lattice_.size[axis] ? stride : 0, down = begin > 0 ? -stride : 0;
    if (axis > 0) {
#pragma omp simd
      for (int i = 0; i < piece.length; ++i) visit(i, up, down);
      return;
    }
    visit(0, last > 0 ? 1 : up, down);
#pragma omp simd
    for (int i = 1; i < last; ++i) visit(i, 1, -1);
    if (last > 0) visit(last, up, -1);
  }

  /// What neighbours that are `far` away show: nothing beyond the border.
  [[gnu::always_inline]] static T shown(const T* weights, std::ptrdiff_t far) { return far == 0 ? T(0) : weights[far]; }

  /// grad I over `edge`.
  void differentiate(const Piece& piece, const T* image, const T* weights, double edge, Arrows& arrows) const {
    const T* own = image + piece.site;
    const T* of_own = weights ? weights + piece.site : nullptr;
    for (int axis = 0; axis < Dim; ++axis) {
      const T half = static_cast<T>(0.5 / (lattice_.spacing[axis] * edge));
      T* to = arrows[axis];
      if (!weights) {
        along(axis, piece,
              [=](int i, std::ptrdiff_t up, std::ptrdiff_t down) { to[i] = half * (own[i + up] - own[i + down]); });
        continue;
      }
      along(axis, piece, [=](int i, std::ptrdiff_t up, std::ptrdiff_t down) {
        const T above = shown(of_own + i, up), below = shown(of_own + i, down);
        // Not a product with 0: what is hidden may be NaN.
        const T to_above = above > 0 ? above * (own[i + up] - own[i]) : T(0);
        const T from_below = below > 0 ? below * (own[i] - own[i + down]) : T(0);
        to[i] = half * (to_above + from_below);
      });
    }
  }

  /// A piece's part of the energy; its duals, of I over edge, and the part of the weights' gradient that is seen there.
  double compare(const Piece& piece, const T* fixed, const T* warped, const T* weights, T* weight_gradient) {
    Arrows g_f, g_w;
    differentiate(piece, fixed, weights, fixed_edge_, g_f);
    differentiate(piece, warped, weights, warped_edge_, g_w);
    const T volume = static_cast<T>(lattice_.cell_volume());
    const T* of_own = weights ? weights + piece.site : nullptr;
    T unlike[kLongestPiece], weight[kLongestPiece], factor[kLongestPiece], f_share[kLongestPiece],
        w_share[kLongestPiece];
#pragma omp simd
    for (int i = 0; i < piece.length; ++i) {
      T n = 0, a = 1, b = 1;
      for (int axis = 0; axis < Dim; ++axis) {
        n += g_f[axis][i] * g_w[axis][i];
        a += g_f[axis][i] * g_f[axis][i];
        b += g_w[axis][i] * g_w[axis][i];
      }
      weight[i] = of_own ? of_own[i] : T(1);
      f_share[i] = n / a;
      w_share[i] = n / b;
      unlike[i] = volume * (1 - f_share[i] * w_share[i]);
      factor[i] = -2 * volume * weight[i] * f_share[i] / b;
    }
    const auto put = [&](T* duals, const Arrows& of, const Arrows& other, const T* share) {
      for (int axis = 0; axis < Dim; ++axis) {
        T* to = duals + static_cast<std::size_t>(axis) * lattice_.sites() + piece.site;
#pragma omp simd
        for (int i = 0; i < piece.length; ++i)
          to[i] = weight[i] == 0 ? T(0) : factor[i] * (other[axis][i] - share[i] * of[axis][i]);
      }
    };
    put(warped_duals_.data(), g_w, g_f, w_share);
    if (weight_gradient) {
      put(fixed_duals_.data(), g_f, g_w, f_share);
      std::copy_n(unlike, piece.length, weight_gradient + piece.site);
    }
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int i = 0; i < piece.length; ++i)
      sum += weight[i] == 0 ? 0.0 : static_cast<double>(weight[i]) * static_cast<double>(unlike[i]);
    return sum;
  }

  /// The transpose of `differentiate`, for a piece: writes to `gradient` (unless null), adds to `weight_gradient`.
  void collect(const Piece& piece, const T* image, const T* weights, const T* duals, double edge, T* gradient,
               T* weight_gradient) const {
    const T* of_own = weights ? weights + piece.site : nullptr;
    const T* own = image + piece.site;
    T image_part[kLongestPiece] = {}, weight_part[kLongestPiece] = {};
    for (int axis = 0; axis < Dim; ++axis) {
      const T half = static_cast<T>(0.5 / (lattice_.spacing[axis] * edge));
      const T* dual = duals + static_cast<std::size_t>(axis) * lattice_.sites() + piece.site;
      if (!weights) {
        // Seen from a neighbour this sample lies the other way.
        along(axis, piece, [&, dual](int i, std::ptrdiff_t up, std::ptrdiff_t down) {
          image_part[i] += half * ((down == 0 ? -dual[i] : dual[i + down]) - (up == 0 ? -dual[i] : dual[i + up]));
        });
      } else {
        along(axis, piece, [&, dual](int i, std::ptrdiff_t up, std::ptrdiff_t down) {
          // What is hidden has duals of 0.
          const T above = shown(of_own + i, up), below = shown(of_own + i, down);
          image_part[i] += half * (of_own[i] * ((down == 0 ? T(0) : dual[i + down]) - (up == 0 ? T(0) : dual[i + up])) +
                                   dual[i] * (below - above));
        });
      }
      if (!weight_gradient) continue;
      along(axis, piece, [&, dual](int i, std::ptrdiff_t up, std::ptrdiff_t down) {
        const bool sees_up = up != 0 && (!of_own || of_own[i + up] > 0);
        const bool sees_down = down != 0 && (!of_own || of_own[i + down] > 0);
        weight_part[i] += half * ((sees_up ? dual[i + up] * (own[i + up] - own[i]) : T(0)) -
                                  (sees_down ? dual[i + down] * (own[i + down] - own[i]) : T(0)));
      });
    }
    if (gradient) {
      T* to = gradient + piece.site;
#pragma omp simd
      for (int i = 0; i < piece.length; ++i) to[i] = of_own && of_own[i] == 0 ? T(0) : image_part[i];
    }
    if (weight_gradient) {
      T* to = weight_gradient + piece.site;
#pragma omp simd
      for (int i = 0; i < piece.length; ++i) to[i] += weight_part[i];
    }
  }

  /// Gradients below this are noise, or small against what the image has elsewhere.
  double edge_of(const T* image, const T* weights) const {
    if (given_edge_ > 0) return given_edge_;
    double per_mm2 = 0;  // mean square of the difference quotients of unit noise
    for (int axis = 0; axis < Dim; ++axis)
      if (lattice_.size[axis] > 1) per_mm2 += 0.5 / (lattice_.spacing[axis] * lattice_.spacing[axis]);
    const double noise = kNoise * noise_sd<Dim>(lattice_, image, weights) * std::sqrt(per_mm2);
    const auto shown_at = [&](std::size_t site) { return weights ? static_cast<double>(weights[site]) : 1.0; };
    const double seen = ordered_sum(lattice_.sites(), shown_at);
    if (!(seen > 0)) return 0;
    const double mean =
        sum_of_pieces(lattice_,
                      [&](const Piece& piece) {
                        Arrows arrows;
                        differentiate(piece, image, weights, 1, arrows);
                        double sum = 0;
                        for (int i = 0; i < piece.length; ++i) {
                          const double weight = shown_at(piece.site + static_cast<std::size_t>(i));
                          if (weight == 0) continue;
                          double square = 0;
                          for (int axis = 0; axis < Dim; ++axis)
                            square += static_cast<double>(arrows[axis][i]) * static_cast<double>(arrows[axis][i]);
                          sum += weight * std::sqrt(square);
                        }
                        return sum;
                      }) /
        seen;
    return std::sqrt(noise * noise + kFloor * kFloor * mean * mean);
  }

  static constexpr double kNoise = 2;    ///< edges against the gradients of the noise
  static constexpr double kFloor = 0.1;  ///< edges against the mean gradient

  Lattice<Dim> lattice_;
  double given_edge_;
  double fixed_edge_ = 0, warped_edge_ = 0;  ///< 0 before `prepare`
  Field<T> warped_duals_, fixed_duals_;      ///< component after component
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_gradient_fields(const Lattice<Dim>& lattice, double edge) {
  return std::make_unique<GradientFields<Dim, T>>(lattice, edge);
}

template std::unique_ptr<Similarity<2, float>> make_gradient_fields(const Lattice<2>&, double);
template std::unique_ptr<Similarity<3, float>> make_gradient_fields(const Lattice<3>&, double);
template std::unique_ptr<Similarity<2, double>> make_gradient_fields(const Lattice<2>&, double);
template std::unique_ptr<Similarity<3, double>> make_gradient_fields(const Lattice<3>&, double);

}  // namespace saltus
