#include "core/flow/coadjoint_transport.h"

#include "core/flow/jump_aware_jacobian.h"
#include "core/flow/scatter.h"
#include "core/support/planes.h"

#include <Eigen/LU>

#include <algorithm>
#include <numeric>

namespace saltus {
namespace {

template <int Dim, class T>
using Square = Eigen::Matrix<T, Dim, Dim, Eigen::RowMajor | Eigen::DontAlign>;
template <int Dim, class T>
using Column = Eigen::Matrix<T, Dim, 1, Eigen::DontAlign>;

template <int Dim, class T>
Square<Dim, T> load_matrix(const T* values) {
  return Eigen::Map<const Square<Dim, T>, Eigen::Unaligned>(values);
}

template <int Dim, class T>
Column<Dim, T> load(const T* values) {
  return Eigen::Map<const Column<Dim, T>, Eigen::Unaligned>(values);
}

template <int Dim, class T>
void add_to(T* values, const Column<Dim, T>& terms) {
  for (int c = 0; c < Dim; ++c) values[c] += terms[c];
}

template <int Dim, class T>
void add_to(T* values, const Square<Dim, T>& terms) {
  for (int k = 0; k < Dim * Dim; ++k) values[k] += terms.data()[k];
}

template <int Count, class T>
bool is_zero(const T* values) {
  for (int c = 0; c < Count; ++c)
    if (values[c] != T(0)) return false;
  return true;
}

template <int Dim, class T>
std::array<T, Dim> as_array(const Column<Dim, T>& column) {
  std::array<T, Dim> values;
  for (int c = 0; c < Dim; ++c) values[c] = column[c];
  return values;
}

template <int Dim, class T>
[[gnu::always_inline]] inline Column<Dim, T> gather(const LinearCell<Dim, T>& cell, const T* field) {
  const std::array<T, Dim> value = cell.template value<Dim>(field);
  return load<Dim, T>(value.data());
}

/// Of `count` sites with the momenta m: adds the field to `value_sum` and its gradient for m, by axis and mm, to
/// `gradient_sum`.
template <int Dim, class T>
[[gnu::noinline]] void pull_piece(const CellLanes<Dim, T>& cells, const T* field, int count, const T* m,
                                  const typename CellLanes<Dim, T>::Vector& per_mm, T* value_sum, T* gradient_sum) {
  const LaneVectors<T> momenta = vectors_of<Dim, T>(m, count), values = vectors_of<Dim, T>(value_sum, count),
                       gradients = vectors_of<Dim, T>(gradient_sum, count);
  cells.visit_gradients(field, momenta, count, [&](int lane, const auto& value, const auto& gradient) {
    put<Dim>(values[lane] + value, value_sum + Dim * lane);
    put<Dim>(gradients[lane] + per_mm * gradient, gradient_sum + Dim * lane);
  });
}

/// The first-order elements at the upper faces, along one axis, of `count` sites in a row (at most as many as lanes).
template <int Dim, class T>
class FaceRow {
 public:
  FaceRow(const MovedSites<Dim, T>& sites, int axis, const Index<Dim>& index, std::size_t site, int count)
      : sites_(sites), axis_(axis), index_(index), site_(site), count_(count) {
    const int length = sites.lattice().size[static_cast<std::size_t>(axis)], at = index[static_cast<std::size_t>(axis)];
    inner_ = axis > 0 ? (at + 1 < length ? count : 0) : std::min(count, length - 1 - at);
  }

  /// The upper one of the two sites that a face lies between; at the lattice's end the only one.
  std::size_t beside(int lane) const {
    const std::size_t site = site_ + static_cast<std::size_t>(lane);
    return lane < inner_ ? site + sites_.strides()[static_cast<std::size_t>(axis_)] : site;
  }

  /// As Face::on(b).
  LanePoints<Dim, T> positions(int b) const {
    const LanePoints<Dim, T> lower = lanes_of<Dim, T>(sites_.displacement() + Dim * site_, count_);
    LanePoints<Dim, T> at = lower;
    if (inner_ > 0) at = lanes_of<Dim, T>(sites_.displacement() + Dim * beside(0), inner_);
    for (int a = 0; a < Dim; ++a) {
      for (int lane = inner_; lane < count_; ++lane) at[a][lane] = lower[a][lane];
      const double first = index_[a] + (a == axis_ ? 0.5 : 0.0), per_mm = sites_.per_mm()[a];
      const T back = a == b ? T(0.5) : T(0);
#pragma omp simd
      for (int lane = 0; lane < CellLanes<Dim, T>::kLanes; ++lane) {
        const T moved = T(0.5) * (lower[a][lane] + at[a][lane]);
        at[a][lane] = static_cast<T>(first + (a == 0 ? lane : 0) + static_cast<double>(moved) * per_mm) - back;
      }
    }
    return at;
  }

 private:
  const MovedSites<Dim, T>& sites_;
  const int axis_;
  const Index<Dim> index_;
  const std::size_t site_;
  const int count_;
  int inner_;  ///< how many of them lie between two sites
};

}  // namespace

/// The first-order element at the upper face of a site along one axis.
template <int Dim, class T>
struct CoadjointTransport<Dim, T>::Face {
  std::array<std::size_t, 2> beside;  ///< the two sites; equal at the lattice's end
  std::array<Index<Dim>, 2> index;
  std::array<T, Dim> at;    ///< index coordinates of its position now
  Square<Dim, T> F, G, dF;  ///< G = F^-T, dF = d_axis F

  /// With its position alone.
  Face(const MovedSites<Dim, T>& sites, int axis, const Index<Dim>& where, std::size_t site) {
    const Lattice<Dim>& lattice = sites.lattice();
    beside = {site, site};
    index = {where, where};
    if (where[axis] + 1 < lattice.size[axis]) {
      beside[1] += sites.strides()[axis];
      ++index[1][axis];
    }
    const T* displacement = sites.displacement();
    for (int a = 0; a < Dim; ++a) {
      const T moved = T(0.5) * (displacement[Dim * beside[0] + a] + displacement[Dim * beside[1] + a]);
      at[a] = static_cast<T>(where[a] + (a == axis ? 0.5 : 0.0) + static_cast<double>(moved) * sites.per_mm()[a]);
    }
  }

  /// Finds the matrices; of sites that have Jacobians.
  void differentiate(const MovedSites<Dim, T>& sites, int axis) {
    F.setZero();
    dF.setZero();
    for (int side = 0; side < 2; ++side) {
      F += T(0.5) * load_matrix<Dim, T>(sites.jacobians() + Dim * Dim * beside[side]);
      T derivative[Dim * Dim];
      SideDifferences<Dim * Dim, Dim, T>(sites.lattice(), index[side], beside[side], sites.strides()[axis], axis,
                                         sites.jacobians(), T(1))
          .combine(derivative);
      dF += static_cast<T>(0.5 / sites.lattice().spacing[axis]) * load_matrix<Dim, T>(derivative);
    }
    G = F.inverse().transpose();
  }

  /// How much of the derivative along `axis` is a derivative along b now.
  T turned(const CoadjointTransport& owner, int b, int axis) const {
    return owner.evolution_ == Evolution::Exact ? F(b, axis) : T(b == axis);
  }

  /// Index coordinates on the lattice of faces along axis b (b < 0: on the sites).
  std::array<T, Dim> on(int b) const {
    std::array<T, Dim> shifted = at;
    if (b >= 0) shifted[b] -= T(0.5);
    return shifted;
  }
};

template <int Dim, class T>
CoadjointTransport<Dim, T>::CoadjointTransport(const Lattice<Dim>& lattice, double unit, bool has_zeroth,
                                               bool has_first, Evolution evolution)
    : lattice_(lattice),
      unit_(evolution == Evolution::Exact ? static_cast<T>(unit) : T(0)),
      evolution_(evolution),
      has_zeroth_(has_zeroth),
      has_first_(has_first) {}

template <int Dim, class T>
template <class Visit>
void CoadjointTransport<Dim, T>::visit_slab_of(const BlockSet<Dim>* blocks, int slab, Visit&& visit) const {
  if (blocks && !blocks->is_complete())
    blocks->visit_slab(slab, visit);
  else
    visit_slab<Dim>(lattice_, slab, visit);
}

template <int Dim, class T>
MomentumMasks<Dim> CoadjointTransport<Dim, T>::reached(const MovedSites<Dim, T>& sites,
                                                       const AxisBlocks<Dim>& blocks) const {
  constexpr int lanes = CellLanes<Dim, T>::kLanes;
  const auto all = BlockMask<Dim>::all(lattice_), none = BlockMask<Dim>::none(lattice_);
  MomentumMasks<Dim> masks(has_zeroth_ ? all : none, none);
  for (int axis = 0; has_first_ && axis < Dim; ++axis) {
    BlockMask<Dim> start = blocks[axis] ? blocks[axis]->mask() : all;
    if (start.is_empty()) continue;
    start.complete_if_dense();  // what most blocks reach is dense as well
    std::vector<int> open;      // orders whose mask has room; -1 is order 0
    for (int b = -1; b < Dim; ++b) {
      if (evolution_ != Evolution::Exact && b != axis) continue;  // nothing turns into another order or axis
      BlockMask<Dim>& mask = b < 0 ? masks.zeroth : masks.first[b];
      if (start.is_all()) mask = all;
      if (!mask.is_all()) open.push_back(b);
    }
    for (int slab = 0; slab < lattice_.size[Dim - 1] && !open.empty(); ++slab)
      start.visit_pieces(lattice_, slab, lanes, [&](const Index<Dim>& index, std::size_t site, int count) {
        const FaceRow<Dim, T> row(sites, axis, index, site, count);
        for (int b : open) (b < 0 ? masks.zeroth : masks.first[b]).mark_cells(lattice_, row.positions(b), count);
      });
  }
  masks.zeroth.complete_if_dense();
  for (BlockMask<Dim>& mask : masks.first) mask.complete_if_dense();
  return masks;
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::push(MovedSites<Dim, T>& sites, const T* zeroth, const T* first,
                                      const AxisBlocks<Dim>& blocks, const MomentumMasks<Dim>& reached, T* zeroth_out,
                                      T* first_out) {
  const std::size_t field = Dim * lattice_.sites();
  reached.zeroth.clear(lattice_, Dim, zeroth_out);
  if (has_zeroth_) {
    const auto all = BlockMask<Dim>::all(lattice_);
    const MovedPoints<Dim, T> moved(lattice_, all, sites.displacement(), lattice_);
    const auto as_they_are = scaled_values<Dim, T>(zeroth, T(1));
    if (!sites.has_jacobians()) {
      scatter<Dim, T>(moved, lattice_, as_they_are, zeroth_out);
    } else {
      scatter<Dim, T>(
          moved, lattice_,
          [&](std::size_t first_site, int count, LaneVectors<T>& out, LaneMask& wanted) {
            as_they_are(first_site, count, out, wanted);
            for (int lane = 0; lane < count; ++lane) {
              if (!wanted[lane]) continue;
              const std::size_t site = first_site + static_cast<std::size_t>(lane);
              const Column<Dim, T> turned =
                  sites.inverse_jacobian(site).transpose() * load<Dim, T>(zeroth + Dim * site);
              for (int c = 0; c < Dim; ++c) out[lane][c] = turned[c];
            }
          },
          zeroth_out);
    }
  }
  if (!has_first_) return;
  for (std::size_t axis = 0; axis < Dim; ++axis) reached.first[axis].clear(lattice_, Dim, first_out + axis * field);
  for (std::size_t axis = 0; axis < Dim; ++axis)
    if (!blocks[axis] || blocks[axis]->sites() > 0)
      push_faces(sites, static_cast<int>(axis), blocks[axis], first + axis * field, zeroth_out, first_out);
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::push_faces(MovedSites<Dim, T>& sites, int axis, const BlockSet<Dim>* blocks,
                                            const T* first, T* zeroth_out, T* first_out) {
  // Only faces with a momentum cost anything: they are listed in the order of their sites.
  const std::size_t field = Dim * lattice_.sites();
  const bool exact = evolution_ == Evolution::Exact;
  struct Element {
    std::array<T, Dim> at, n;
  };
  struct Turned {
    std::array<T, Dim> zeroth;
    std::array<T, Dim> into;  ///< how much of it is along which axis now
  };
  const int slabs = lattice_.size[Dim - 1];
  std::vector<std::size_t> begin(static_cast<std::size_t>(slabs) + 1, 0);
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < slabs; ++slab)
    visit_slab_of(blocks, slab, [&](const Index<Dim>&, std::size_t site) {
      if (!is_zero<Dim, T>(first + Dim * site)) ++begin[static_cast<std::size_t>(slab) + 1];
    });
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<Element> elements(begin.back());
  std::vector<Turned> turned(exact ? elements.size() : 0);
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < slabs; ++slab) {
    std::size_t k = begin[static_cast<std::size_t>(slab)];
    visit_slab_of(blocks, slab, [&](const Index<Dim>& index, std::size_t site) {
      if (is_zero<Dim, T>(first + Dim * site)) return;
      Face face(sites, axis, index, site);
      Element& element = elements[k];
      element.at = face.at;
      if (!sites.has_jacobians()) {
        std::copy_n(first + Dim * site, Dim, element.n.begin());
      } else {
        face.differentiate(sites, axis);
        const Column<Dim, T> n = face.G * load<Dim, T>(first + Dim * site);
        element.n = as_array<Dim, T>(n);
        if (exact) {
          turned[k].zeroth = as_array<Dim, T>(unit_ * (face.G * (face.dF.transpose() * n)));
          for (int b = 0; b < Dim; ++b) turned[k].into[b] = face.F(b, axis);
        }
      }
      ++k;
    });
  }
  for (int b = -1; b < Dim; ++b) {
    if (!exact && b != axis) continue;  // nothing turns into another order or axis
    const auto points = listed_points<Dim, T>(elements.size(), [&](std::size_t i) {
      std::array<T, Dim> at = elements[i].at;
      if (b >= 0) at[b] -= T(0.5);
      return at;
    });
    scatter<Dim, T>(
        points, lattice_,
        [&](std::size_t first_element, int count, LaneVectors<T>& out, LaneMask& wanted) {
          for (int lane = 0; lane < count; ++lane) {
            const std::size_t i = first_element + static_cast<std::size_t>(lane);
            const std::array<T, Dim>& n = b < 0 ? turned[i].zeroth : elements[i].n;
            for (int c = 0; c < Dim; ++c) out[lane][c] = b >= 0 && exact ? n[c] * turned[i].into[b] : n[c];
            wanted[lane] = true;
          }
        },
        b < 0 ? zeroth_out : first_out + static_cast<std::size_t>(b) * field);
  }
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::push_adjoint(MovedSites<Dim, T>& sites, const T* zeroth, const T* first,
                                              const AxisBlocks<Dim>& wanted, const T* zeroth_out_dual,
                                              const T* first_out_dual, T* displacement_dual, T* zeroth_dual,
                                              T* first_dual) {
  if (has_zeroth_) zeroth_adjoint(sites, zeroth, zeroth_out_dual, displacement_dual, zeroth_dual);
  if (!has_first_) return;
  for (int axis = 0; axis < Dim; ++axis) {
    if (wanted[axis] && wanted[axis]->sites() == 0) continue;
    const std::size_t at = static_cast<std::size_t>(axis) * Dim * lattice_.sites();
    const T* momenta = first ? first + at : nullptr;
    if (sites.has_jacobians())
      face_adjoint(sites, axis, wanted[axis], momenta, zeroth_out_dual, first_out_dual, displacement_dual,
                   first_dual + at);
    else
      carried_face_adjoint(sites, axis, wanted[axis], momenta, first_out_dual + at, displacement_dual, first_dual + at);
  }
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::zeroth_adjoint(MovedSites<Dim, T>& sites, const T* zeroth, const T* dual_field,
                                                T* displacement_dual, T* zeroth_dual) {
  const auto all = BlockMask<Dim>::all(lattice_);
  const MovedPoints<Dim, T> moved(lattice_, all, sites.displacement(), lattice_);
  if (!sites.has_jacobians()) {  // the position alone moves with the displacement
    typename CellLanes<Dim, T>::Vector per_mm{};
    for (int c = 0; c < Dim; ++c) per_mm[c] = static_cast<T>(sites.per_mm()[c]);
    for_cells<Dim, T>(moved, lattice_, [&](std::size_t first, int count, const CellLanes<Dim, T>& cells) {
      pull_piece<Dim, T>(cells, dual_field, count, zeroth + Dim * first, per_mm, zeroth_dual + Dim * first,
                         displacement_dual + Dim * first);
    });
    return;
  }
  for_cells<Dim, T>(moved, lattice_, [&](std::size_t first, int count, const CellLanes<Dim, T>& cells) {
    for (int lane = 0; lane < count; ++lane) {
      const std::size_t site = first + static_cast<std::size_t>(lane);
      const LinearCell<Dim, T> cell = cells.cell(lane);
      const Square<Dim, T> G = sites.inverse_jacobian(site).transpose();
      const Column<Dim, T> dual = gather<Dim, T>(cell, dual_field), pulled = G.transpose() * dual;
      add_to<Dim, T>(zeroth_dual + Dim * site, pulled);
      if (is_zero<Dim, T>(zeroth + Dim * site)) continue;
      const Column<Dim, T> m = load<Dim, T>(zeroth + Dim * site), pushed = G * m;
      const std::array<T, Dim> gradient = cell.template pulled_back_gradient<Dim>(dual_field, as_array<Dim, T>(pushed));
      for (int a = 0; a < Dim; ++a)
        displacement_dual[Dim * site + a] += gradient[a] * static_cast<T>(sites.per_mm()[a]);
      // d G = -G dF^T G, so the dual of F is -G (dual m^T)^T G = -(G m) (G^T dual)^T.
      add_to<Dim, T>(sites.jacobian_duals() + Dim * Dim * site, Square<Dim, T>(-pushed * pulled.transpose()));
    }
  });
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::face_adjoint(MovedSites<Dim, T>& sites, int axis, const BlockSet<Dim>* blocks,
                                              const T* first, const T* zeroth_out_dual, const T* first_out_dual,
                                              T* displacement_dual, T* first_dual) {
  const std::size_t field = Dim * lattice_.sites();
  // A face touches its two sites and, through d_c F, their neighbours: four planes.
  for_planes_apart<4>(lattice_.size[Dim - 1], [&](int slab) {
    visit_slab_of(blocks, slab, [&](const Index<Dim>& where, std::size_t site) {
      Face face(sites, axis, where, site);
      face.differentiate(sites, axis);
      const LinearCell<Dim, T> zeroth_cell(lattice_, face.on(-1));
      const bool exact = evolution_ == Evolution::Exact;
      Column<Dim, T> s_dual = Column<Dim, T>::Zero(), n_dual = Column<Dim, T>::Zero(), dual[Dim];
      if (exact) {
        s_dual = face.G.transpose() * gather<Dim, T>(zeroth_cell, zeroth_out_dual);
        n_dual = unit_ * (face.dF * s_dual);
      }
      for (int b = 0; b < Dim; ++b) {
        if (!exact && b != axis) continue;
        dual[b] = gather<Dim, T>(LinearCell<Dim, T>(lattice_, face.on(b)), first_out_dual + b * field);
        n_dual += face.turned(*this, b, axis) * dual[b];
      }
      const Column<Dim, T> pulled = face.G.transpose() * n_dual;
      add_to<Dim, T>(first_dual + Dim * site, pulled);
      if (!first || is_zero<Dim, T>(first + Dim * site)) return;

      const Column<Dim, T> n = face.G * load<Dim, T>(first + Dim * site);
      std::array<T, Dim> gradient{};
      Square<Dim, T> F_dual = -n * pulled.transpose();
      if (exact) {  // only then is anything known of zeroth_out_dual
        const Column<Dim, T> pushed0 = face.G * (unit_ * (face.dF.transpose() * n));
        gradient = zeroth_cell.template pulled_back_gradient<Dim>(zeroth_out_dual, as_array<Dim, T>(pushed0));
        F_dual -= pushed0 * s_dual.transpose();
      }
      for (int b = 0; b < Dim; ++b) {
        if (!exact && b != axis) continue;
        if (exact) F_dual(b, axis) += dual[b].dot(n);
        const Column<Dim, T> pushed = face.turned(*this, b, axis) * n;
        const std::array<T, Dim> more =
            LinearCell<Dim, T>(lattice_, face.on(b))
                .template pulled_back_gradient<Dim>(first_out_dual + b * field, as_array<Dim, T>(pushed));
        for (int a = 0; a < Dim; ++a) gradient[a] += more[a];
      }
      for (int side = 0; side < 2; ++side)
        for (int a = 0; a < Dim; ++a)
          displacement_dual[Dim * face.beside[side] + a] += T(0.5) * gradient[a] * static_cast<T>(sites.per_mm()[a]);
      const Square<Dim, T> dF_dual = static_cast<T>(0.5 / lattice_.spacing[axis]) * unit_ * (n * s_dual.transpose());
      for (int side = 0; side < 2; ++side) {
        const std::size_t beside = face.beside[side];
        add_to<Dim, T>(sites.jacobian_duals() + Dim * Dim * beside, Square<Dim, T>(T(0.5) * F_dual));
        SideDifferences<Dim * Dim, Dim, T>(lattice_, face.index[side], beside, sites.strides()[axis], axis,
                                           sites.jacobians(), T(1))
            .adjoint(dF_dual.data(), beside, sites.strides()[axis], T(1), sites.jacobian_duals());
      }
    });
  });
}

/// face_adjoint where F is the identity: nothing turns, and the position alone moves with the displacement.
template <int Dim, class T>
void CoadjointTransport<Dim, T>::carried_face_adjoint(const MovedSites<Dim, T>& sites, int axis,
                                                      const BlockSet<Dim>* blocks, const T* first, const T* out_dual,
                                                      T* displacement_dual, T* first_dual) {
  using Vector = typename CellLanes<Dim, T>::Vector;
  constexpr int lanes = CellLanes<Dim, T>::kLanes;
  Vector half{};
  for (int a = 0; a < Dim; ++a) half[a] = static_cast<T>(0.5 * sites.per_mm()[a]);
  const auto add = [](const Vector& terms, T* values) {
    for (int c = 0; c < Dim; ++c) values[c] += terms[c];
  };
  const BlockMask<Dim> where = blocks ? blocks->mask() : BlockMask<Dim>::all(lattice_);
  for_planes_apart<2>(lattice_.size[Dim - 1], [&](int slab) {
    CellLanes<Dim, T> cells(lattice_);
    where.visit_pieces(lattice_, slab, lanes, [&](const Index<Dim>& index, std::size_t site, int count) {
      const FaceRow<Dim, T> row(sites, axis, index, site, count);
      cells.find(row.positions(axis));
      T* to = first_dual + Dim * site;
      const auto add_value = [&](int lane, const Vector& value) { add(value, to + Dim * lane); };
      if (!first) return cells.visit_vectors(out_dual, count, add_value);
      const LaneVectors<T> momenta = vectors_of<Dim, T>(first + Dim * site, count);
      LaneMask moves;
      mark_nonzero<Dim, T>(momenta, moves);
      cells.visit_gradients(out_dual, momenta, count, [&](int lane, const Vector& value, const Vector& gradient) {
        add_value(lane, value);
        if (!moves[static_cast<std::size_t>(lane)]) return;  // its own gradient alone is asked for
        add(half * gradient, displacement_dual + Dim * (site + static_cast<std::size_t>(lane)));
        add(half * gradient, displacement_dual + Dim * row.beside(lane));
      });
    });
  });
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::pull_back(const MovedSites<Dim, T>& sites, const T* field, T scale, T* sum) const {
  const auto all = BlockMask<Dim>::all(lattice_);
  const MovedPoints<Dim, T> moved(lattice_, all, sites.displacement(), lattice_);
  for_cells<Dim, T>(moved, lattice_, [&](std::size_t first, int count, const CellLanes<Dim, T>& cells) {
    T* to = sum + Dim * first;
    if (!sites.has_jacobians()) {
      const LaneVectors<T> before = vectors_of<Dim, T>(to, count);
      cells.visit_vectors(
          field, count, [&](int lane, const auto& value) { put<Dim>(before[lane] + scale * value, to + Dim * lane); });
      return;
    }
    cells.visit_vectors(field, count, [&](int lane, const auto& value) {
      Column<Dim, T> column;
      for (int c = 0; c < Dim; ++c) column[c] = value[c];
      add_to<Dim, T>(to + Dim * lane,
                     Column<Dim, T>(scale * (sites.inverse_jacobian(first + static_cast<std::size_t>(lane)) * column)));
    });
  });
}

template class CoadjointTransport<2, float>;
template class CoadjointTransport<3, float>;
template class CoadjointTransport<2, double>;
template class CoadjointTransport<3, double>;

}  // namespace saltus
