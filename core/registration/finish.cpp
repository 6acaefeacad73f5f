#include "core/registration/finish.h"

#include "core/flow/backward_map.h"
#include "core/grid/block_mask.h"
#include "core/grid/cell_lanes.h"
#include "core/grid/interpolation.h"
#include "core/grid/jacobian_determinant.h"
#include "core/support/ranking.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
AffineMap<Dim> frame_to_index(const RegistrationInput<Dim>& input) {
  const ImageGrid<Dim>&fixed = input.fixed.grid, &moving = input.moving.grid;
  // world = origin_f + R_f p; index = (R_m^T (A world + b - origin_m)) / spacing_m
  const Matrix<Dim> scale = moving.spacing.cwiseInverse().asDiagonal();
  AffineMap<Dim> map;
  map.linear = scale * moving.direction.transpose() * input.start.linear * fixed.direction;
  map.offset = scale * moving.direction.transpose() * (input.start(fixed.origin) - moving.origin);
  return map;
}

namespace {

/// A point, and what x + u(x) misses there of what it should be, mm.
template <int Dim>
struct Undone {
  Vector<Dim> at, missing;
  double square;  ///< of what is missing, mm^2
};

/// What is affine in a site's index: of the sites of an image with x fastest, as rows of it are gone along.
template <int Dim>
class AffineOfIndex {
 public:
  /// `of` gives it for an index as a vector.
  template <class Function>
  explicit AffineOfIndex(const Function& of) : at_zero_(of(Vector<Dim>::Zero().eval())) {
    for (int axis = 0; axis < Dim; ++axis) step_.col(axis) = of(Vector<Dim>::Unit(axis).eval()) - at_zero_;
  }
  Vector<Dim> operator()(const Index<Dim>& index) const {
    Vector<Dim> value = at_zero_;
    for (int axis = 0; axis < Dim; ++axis) value += index[axis] * step_.col(axis);
    return value;
  }
  /// From a site to the next one along x.
  Vector<Dim> step() const { return step_.col(0); }

 private:
  Vector<Dim> at_zero_;
  Matrix<Dim> step_;
};

/// Solves x + u(x) = y for a displacement that is taken linearly between the sites of a lattice, as users take it, by
/// Newton's method with the slopes of the cell that x is in.
template <int Dim>
class Undoing {
 public:
  using Points = LanePoints<Dim, float>;
  using Lanes = typename CellLanes<Dim, float>::Lanes;
  static constexpr int kLanes = CellLanes<Dim, float>::kLanes;

  Undoing(const Lattice<Dim>& lattice, const Field<float>& displacement)
      : lattice_(lattice), displacement_(displacement) {
    double least = lattice.spacing[0];
    for (int axis = 0; axis < Dim; ++axis) {
      per_mm_[axis] = 1 / lattice.spacing[axis];
      extent_[axis] = (lattice.size[axis] - 1) * lattice.spacing[axis];
      least = std::min(least, lattice.spacing[axis]);
    }
    close_ = 1e-4 * least;
  }

  bool is_close(const Undone<Dim>& found) const { return found.square <= close_ * close_; }

  /// Of y, y + step, ... side by side: `apart` is x - y, from where it begins to where it ends, and `square` that of
  /// what is missing then, as in Undone. Where Newton's method alone does not lead on, it ends early.
  void of_row(const Vector<Dim>& y, const Vector<Dim>& step, int count, Points& apart, Lanes& square) const {
    Points at_rest, missing{}, next_missing{}, next;
    Slopes slopes{}, next_slopes{};
    for (int c = 0; c < Dim; ++c)
      for (int lane = 0; lane < kLanes; ++lane)
        at_rest[c][lane] = static_cast<float>((y[c] + lane * step[c]) * per_mm_[c]);
    look_at_row(at_rest, count, apart, missing, square, slopes);
    const float close = static_cast<float>(close_ * close_);
    for (int round = 0; round < kMostRowRounds; ++round) {
      if (std::all_of(square.begin(), square.begin() + count, [=](float one) { return one <= close; })) return;
      for (int lane = 0; lane < kLanes; ++lane) {
        Eigen::Matrix<float, Dim, Dim> cell;
        Eigen::Matrix<float, Dim, 1> rest;
        for (int c = 0; c < Dim; ++c) {
          rest[c] = missing[c][lane];
          for (int axis = 0; axis < Dim; ++axis) cell(c, axis) = slopes[c][axis][lane];
        }
        const Eigen::Matrix<float, Dim, 1> change = cell.inverse() * rest;
        for (int c = 0; c < Dim; ++c) next[c][lane] = apart[c][lane] + change[c];
      }
      Lanes next_square;
      look_at_row(at_rest, count, next, next_missing, next_square, next_slopes);
      for (int lane = 0; lane < count; ++lane) {
        bool is_better = square[lane] > close && next_square[lane] < square[lane];
        for (int c = 0; c < Dim; ++c)
          for (const Points* one : {&apart, &next}) {
            const double at = at_rest[c][lane] / per_mm_[c] + (*one)[c][lane];
            is_better = is_better && at >= 0 && at <= extent_[c];
          }
        if (!is_better) continue;
        square[lane] = next_square[lane];
        for (int c = 0; c < Dim; ++c) {
          apart[c][lane] = next[c][lane];
          missing[c][lane] = next_missing[c][lane];
          for (int axis = 0; axis < Dim; ++axis) slopes[c][axis][lane] = next_slopes[c][axis][lane];
        }
      }
    }
  }

  /// From `first`; as near as it comes within the lattice.
  Undone<Dim> of(const Vector<Dim>& y, const Vector<Dim>& first) const {
    Matrix<Dim> slopes, other_slopes;
    Undone<Dim> place = look_at(y, first, slopes);
    for (int round = 0; round < kMostRounds && !is_close(place) && is_inside(place.at); ++round) {
      Undone<Dim> next = look_at(y, place.at + slopes.inverse() * place.missing, other_slopes);
      if (!(next.square < place.square)) next = look_at(y, place.at + place.missing, other_slopes);
      if (!(next.square < place.square) || !is_inside(next.at)) break;
      place = next;
      slopes = other_slopes;
    }
    return place;
  }

 private:
  static constexpr int kMostRounds = 12, kMostRowRounds = 2;
  using Slopes = std::array<Points, Dim>;  ///< of x + u(x), by component and axis

  [[gnu::always_inline]] void look_at_row(const Points& at_rest, int count, const Points& apart, Points& missing,
                                          Lanes& square, Slopes& slopes) const {
    Points at;
    for (int c = 0; c < Dim; ++c)
#pragma omp simd
      for (int lane = 0; lane < kLanes; ++lane)
        at[c][lane] = at_rest[c][lane] + apart[c][lane] * static_cast<float>(per_mm_[c]);
    CellLanes<Dim, float> cells(lattice_);
    cells.find(at);
    square = {};
    for (int lane = 0; lane < count; ++lane) {
      std::array<std::array<float, Dim>, Dim> of_u;
      const auto u = cells.cell(lane).template value_and_slopes<Dim>(displacement_.data(), of_u);
      for (int c = 0; c < Dim; ++c) {
        missing[c][lane] = -(apart[c][lane] + u[c]);
        square[lane] += missing[c][lane] * missing[c][lane];
        for (int axis = 0; axis < Dim; ++axis)
          slopes[c][axis][lane] = (c == axis) + of_u[c][axis] * static_cast<float>(per_mm_[axis]);
      }
    }
  }

  /// With the slopes of x + u(x) there.
  [[gnu::always_inline]] Undone<Dim> look_at(const Vector<Dim>& y, const Vector<Dim>& at, Matrix<Dim>& slopes) const {
    std::array<float, Dim> coordinates;
    for (int c = 0; c < Dim; ++c) coordinates[c] = static_cast<float>(at[c] * per_mm_[c]);
    std::array<std::array<float, Dim>, Dim> of_u;
    const auto u =
        LinearCell<Dim, float>(lattice_, coordinates).template value_and_slopes<Dim>(displacement_.data(), of_u);
    Undone<Dim> place{at, y - at, 0};
    for (int c = 0; c < Dim; ++c) {
      place.missing[c] -= u[c];
      place.square += place.missing[c] * place.missing[c];
      for (int axis = 0; axis < Dim; ++axis) slopes(c, axis) = (c == axis) + of_u[c][axis] * per_mm_[axis];
    }
    return place;
  }
  bool is_inside(const Vector<Dim>& at) const {
    return (at.array() >= 0).all() && (at.array() <= extent_.array()).all();
  }

  Lattice<Dim> lattice_;
  const Field<float>& displacement_;
  Vector<Dim> per_mm_, extent_;
  double close_;
};

/// Fills the inverse displacement and the summary's consistency. It starts at moving voxels: y -> frame point A^-1 y,
/// forward with the flow, to where `backward` leads back to it, back to world.
template <int Dim>
void write_inverse(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                   const std::vector<Field<float>>& velocities, const Field<float>& backward,
                   RegistrationResult<Dim>& result) {
  const ImageGrid<Dim>&fixed = input.fixed.grid, &moving = input.moving.grid;
  const Lattice<Dim> moving_lattice = lattice_of(moving);
  const Matrix<Dim> inverse = input.start.linear.inverse();
  const auto frame_of = [&](const Vector<Dim>& index) -> Vector<Dim> {
    return fixed.direction.transpose() * (inverse * (moving.to_world(index) - input.start.offset) - fixed.origin);
  };
  const AffineOfIndex<Dim> start(frame_of);
  const AffineOfIndex<Dim> start_from_site([&](const Vector<Dim>& index) -> Vector<Dim> {  // mm, in the moving frame
    Vector<Dim> apart = frame_of(index);
    for (int c = 0; c < Dim; ++c) apart[c] -= moving_lattice.offset[c] + index[c] * moving_lattice.spacing[c];
    return apart;
  });
  const AffineOfIndex<Dim> back_at_start([&](const Vector<Dim>& index) -> Vector<Dim> {
    return fixed.origin + fixed.direction * frame_of(index) - moving.to_world(index);
  });
  result.inverse_displacement = VectorVolume<Dim>(moving);
  std::array<float*, Dim> inverse_displacement;
  for (int c = 0; c < Dim; ++c) inverse_displacement[c] = result.inverse_displacement.component(c);
  const Undoing<Dim> undoing(lattice_of(fixed), backward);
  std::vector<float> consistency(moving_lattice.sites());
  const std::size_t sites_of_slab = moving_lattice.sites() / static_cast<std::size_t>(moving_lattice.size[Dim - 1]);
  Field<float> moved;  // from the moving image's own sites, some slabs at a time
  Lattice<Dim> some = moving_lattice;
  for (int begin = 0; begin < moving_lattice.size[Dim - 1]; begin += some.size[Dim - 1]) {
    some.size[Dim - 1] = std::min(kSlabsAtOnce<Dim>, moving_lattice.size[Dim - 1] - begin);
    some.offset[Dim - 1] = moving_lattice.offset[Dim - 1] + begin * moving_lattice.spacing[Dim - 1];
    moved.resize(Dim * some.sites());
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < some.size[Dim - 1]; ++slab)
      visit_slab<Dim>(some, slab, [&](Index<Dim> index, std::size_t site) {
        index[Dim - 1] += begin;
        const Vector<Dim> apart = start_from_site(index);
        for (int c = 0; c < Dim; ++c) moved[Dim * site + c] = static_cast<float>(apart[c]);
      });
    move_forward<Dim, float>(some, lattice, velocities, moved);
    const std::size_t first_site = static_cast<std::size_t>(begin) * sites_of_slab;
    const auto all = BlockMask<Dim>::all(some);
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < some.size[Dim - 1]; ++slab)
      all.visit_pieces(some, slab, Undoing<Dim>::kLanes, [&](Index<Dim> index, std::size_t site, int count) {
        index[Dim - 1] += begin;
        const Vector<Dim> first = start(index), first_back = back_at_start(index);
        LanePoints<Dim, float> apart{};
        Vector<Dim> from_site = start_from_site(index);
        for (int lane = 0; lane < count; ++lane, from_site += start_from_site.step())
          for (int c = 0; c < Dim; ++c)
            apart[c][lane] =
                static_cast<float>(moved[Dim * (site + static_cast<std::size_t>(lane)) + c] - from_site[c]);
        typename Undoing<Dim>::Lanes square;
        undoing.of_row(first, start.step(), count, apart, square);
        for (int lane = 0; lane < count; ++lane) {
          Undone<Dim> found{{}, {}, square[lane]};
          Vector<Dim> way;
          for (int c = 0; c < Dim; ++c) way[c] = apart[c][lane];
          if (!undoing.is_close(found)) {
            const Vector<Dim> y = first + lane * start.step();
            found = undoing.of(y, y + way);
            // Where that finds no way, across a fold or a jump, the flow is undone step by step first.
            if (!undoing.is_close(found)) {
              const Undone<Dim> other = undoing.of(y, forward_point<Dim, float>(lattice, velocities, y));
              if (other.square < found.square) found = other;
            }
            way = found.at - y;
          }
          const Vector<Dim> back = first_back + lane * back_at_start.step() + fixed.direction * way;
          for (int c = 0; c < Dim; ++c)
            inverse_displacement[c][first_site + site + static_cast<std::size_t>(lane)] = static_cast<float>(back[c]);
          consistency[first_site + site + static_cast<std::size_t>(lane)] = static_cast<float>(std::sqrt(found.square));
        }
      });
  }
  result.summary.inverse_consistency_mm = ranking_of(consistency.size(), consistency.data()).at(consistency.size() / 2);
}

}  // namespace

template <int Dim>
Field<float> map_back(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                      const std::vector<Field<float>>& velocities) {
  return backward_map<Dim, float>(lattice_of(input.fixed.grid), lattice, velocities);
}

template <int Dim>
void write_fields(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                  const std::vector<Field<float>>& velocities, const Field<float>& backward,
                  RegistrationResult<Dim>& result) {
  const ImageGrid<Dim>&fixed = input.fixed.grid, &moving = input.moving.grid;
  const Lattice<Dim> fixed_lattice = lattice_of(fixed), moving_lattice = lattice_of(moving);

  // Frame -> world: x + u(x) = A (x + R psi_u) + b.
  result.displacement = VectorVolume<Dim>(fixed);
  const Matrix<Dim> turn = input.start.linear * fixed.direction;
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < fixed_lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(fixed_lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      Vector<Dim> at, u;
      for (int c = 0; c < Dim; ++c) {
        at[c] = index[c];
        u[c] = backward[Dim * site + c];
      }
      const Vector<Dim> world = fixed.to_world(at);
      const Vector<Dim> moved = (input.start.linear - Matrix<Dim>::Identity()) * world + input.start.offset + turn * u;
      for (int c = 0; c < Dim; ++c) result.displacement.component(c)[site] = static_cast<float>(moved[c]);
    });

  write_inverse(input, lattice, velocities, backward, result);
  result.jacobian = jacobian_determinant(result.displacement);
  result.summary.min_jacobian = *std::min_element(result.jacobian.samples.begin(), result.jacobian.samples.end());
  result.summary.share_jacobian_not_positive =
      static_cast<double>(std::count_if(result.jacobian.samples.begin(), result.jacobian.samples.end(),
                                        [](float j) { return j <= 0; })) /
      static_cast<double>(result.jacobian.samples.size());

  FramedImage<Dim, float> image{moving_lattice, input.moving.samples, frame_to_index(input).linear,
                                frame_to_index(input).offset};
  result.warped = Volume<Dim>(fixed);
  warp<Dim, float>(image, fixed_lattice, backward.data(), result.warped.samples.data());
}

template <int Dim>
void collect_momenta(const std::vector<MomentumScale<Dim, float>*>& scales,
                     const std::vector<MomentumPointers<float>>& momenta, const ImageGrid<Dim>& fixed,
                     RegistrationResult<Dim>& result) {
  std::size_t sites_active = 0, sites_all = 0;
  for (std::size_t s = 0; s < scales.size(); ++s) {
    const MomentumScale<Dim, float>* scale = scales[s];
    const Lattice<Dim>& lattice = scale->lattice();
    MomentumField<Dim> field;
    field.kernel = scale->options().kernel.name();
    field.width_mm = scale->options().kernel.width();
    ImageGrid<Dim> grid = fixed;
    Vector<Dim> offset;
    for (int axis = 0; axis < Dim; ++axis) {
      grid.size[axis] = lattice.size[axis];
      grid.spacing[axis] = lattice.spacing[axis];
      offset[axis] = lattice.offset[axis];
    }
    grid.origin = fixed.origin + fixed.direction * offset;
    const auto take = [&](int axis, const float* values) {
      field.axis = axis;
      field.vectors = VectorVolume<Dim>(grid);
      for (std::size_t site = 0; site < lattice.sites(); ++site) {
        bool is_active = false;
        for (int c = 0; c < Dim; ++c) {
          const float value = values[Dim * site + c];
          field.vectors.component(c)[site] = value;
          is_active = is_active || value != 0;
        }
        if (axis >= 0) sites_active += is_active, ++sites_all;
      }
      result.momenta.push_back(field);
    };
    if (momenta[s].zeroth) take(-1, momenta[s].zeroth);
    for (int axis = 0; axis < Dim && momenta[s].first; ++axis)
      take(axis, momenta[s].first + static_cast<std::size_t>(axis) * scale->field_size());
    if (const auto* oriented = scale->oriented(); oriented && momenta[s].elements && !momenta[s].elements->empty()) {
      using Oriented = OrientedMomenta<Dim, float>;
      std::vector<float> corners, sums(scale->field_size(), 0.0f);
      oriented->place(*momenta[s].elements, corners);
      for (std::size_t e = 0; e < momenta[s].elements->size(); ++e) {
        const auto place = Oriented::placement(corners.data() + Oriented::kCornerValues * e);
        const std::size_t site = oriented->site_of((*momenta[s].elements)[e]);
        for (int j = 1; j < Dim; ++j)
          for (int c = 0; c < Dim; ++c)
            sums[Dim * site + c] += momenta[s].oriented[Oriented::kComponents * e + j - 1] * place.axes(j, c);
      }
      field.normal_width_mm = oriented->options().normal_width_mm();
      take(MomentumField<Dim>::kOriented, sums.data());
    }
  }
  if (sites_all > 0) result.summary.active_first_order_share = static_cast<double>(sites_active) / sites_all;
}

template <int Dim>
void summarise_similarity(const MatchingLevel<Dim, float>& full, const RegistrationOptions& options,
                          const Field<float>& backward, RegistrationResult<Dim>& result) {
  const Lattice<Dim>& lattice = full.lattice;
  const std::size_t sites = lattice.sites();
  const auto similarity =
      make_similarity<Dim, float>(options.similarity, lattice, options.similarity_parameters,
                                  *std::min_element(lattice.spacing.begin(), lattice.spacing.end()));
  Field<float> warped, weights, gradient(sites);
  const auto shown = [&] { return weights.empty() ? nullptr : weights.data(); };
  const auto evaluate = [&](const Displacement<Dim, float>& displacement) {
    warp_level<Dim, float>(full, displacement, warped, weights);
    return similarity->evaluate(full.fixed.data(), warped.data(), shown(), gradient.data(), nullptr);
  };
  const Displacement<Dim, float> frame;
  warp_level<Dim, float>(full, frame, warped, weights);
  similarity->prepare(full.fixed.data(), warped.data(), shown());
  result.summary.similarity_before = evaluate(frame);
  result.summary.similarity_after = evaluate({backward.data()});
}

#define SALTUS_FINISH(DIM)                                                                                         \
  template AffineMap<DIM> frame_to_index(const RegistrationInput<DIM>&);                                           \
  template Field<float> map_back(const RegistrationInput<DIM>&, const Lattice<DIM>&,                               \
                                 const std::vector<Field<float>>&);                                                \
  template void write_fields(const RegistrationInput<DIM>&, const Lattice<DIM>&, const std::vector<Field<float>>&, \
                             const Field<float>&, RegistrationResult<DIM>&);                                       \
  template void collect_momenta(const std::vector<MomentumScale<DIM, float>*>&,                                    \
                                const std::vector<MomentumPointers<float>>&, const ImageGrid<DIM>&,                \
                                RegistrationResult<DIM>&);                                                         \
  template void summarise_similarity(const MatchingLevel<DIM, float>&, const RegistrationOptions&,                 \
                                     const Field<float>&, RegistrationResult<DIM>&);
SALTUS_FINISH(2)
SALTUS_FINISH(3)
#undef SALTUS_FINISH

}  // namespace saltus
