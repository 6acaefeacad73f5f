#include "core/flow/coadjoint_transport.h"

#include "core/flow/jump_aware_jacobian.h"

#include <Eigen/LU>

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
void add(T* values, const Column<Dim, T>& terms) {
  for (int c = 0; c < Dim; ++c) values[c] += terms[c];
}

template <int Dim, class T>
bool is_zero(const T* values) {
  for (int c = 0; c < Dim; ++c)
    if (values[c] != T(0)) return false;
  return true;
}

/// Planes of the last axis in three rounds, so that what a plane adds to its neighbours meets no other thread and
/// always comes in the same order.
template <class Plane>
void for_planes_apart(int planes, Plane&& plane) {
  for (int round = 0; round < 3; ++round) {
#pragma omp parallel for schedule(static)
    for (int p = round; p < planes; p += 3) plane(p);
  }
}

}  // namespace

/// Everything the transport of one site needs; the formulas of the header and their adjoint.
template <int Dim, class T>
struct CoadjointTransport<Dim, T>::Site {
  Square<Dim, T> F, G;  // G = F^-T
  Square<Dim, T> dF[Dim];
  Column<Dim, T> m0, m[Dim], n[Dim], p[Dim], s;
  bool active = false, first_active = false;

  /// `first` is the first of Dim fields that are `field` apart, or null.
  Site(const CoadjointTransport& owner, const Index<Dim>& index, std::size_t site, const T* zeroth, const T* first) {
    const std::size_t field = Dim * owner.lattice_.sites();
    F = load_matrix<Dim, T>(owner.jacobian_.data() + Dim * Dim * site);
    G = F.inverse().transpose();
    if (zeroth && !is_zero<Dim, T>(zeroth + Dim * site)) active = true;
    m0 = zeroth ? load<Dim, T>(zeroth + Dim * site) : Column<Dim, T>(Column<Dim, T>::Zero());
    s = m0;
    if (!first) return;
    for (int b = 0; b < Dim; ++b) {
      m[b] = load<Dim, T>(first + b * field + Dim * site);
      if (!is_zero<Dim, T>(m[b].data())) first_active = true;
    }
    if (!first_active) return;
    active = true;
    for (int b = 0; b < Dim; ++b) {
      T derivative[Dim * Dim];
      SideDifferences<Dim * Dim, Dim, T>(owner.lattice_, index, site, owner.stride_[b], b, owner.jacobian_.data(), T(1))
          .combine(derivative);
      dF[b] = load_matrix<Dim, T>(derivative) / static_cast<T>(owner.lattice_.spacing[b]);
      n[b] = G * m[b];
      s += owner.unit_ * (dF[b].transpose() * n[b]);
      p[b].setZero();
      for (int c = 0; c < Dim; ++c) p[b] += F(b, c) * m[c];
    }
  }

  Column<Dim, T> zeroth() const { return G * s; }
  Column<Dim, T> first(int b) const { return G * p[b]; }
};

template <int Dim, class T>
CoadjointTransport<Dim, T>::CoadjointTransport(const Lattice<Dim>& lattice, double unit, bool has_zeroth, bool has_first)
    : lattice_(lattice), unit_(static_cast<T>(unit)), has_zeroth_(has_zeroth), has_first_(has_first) {
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    stride_[axis] = stride;
    stride *= static_cast<std::size_t>(lattice.size[axis]);
  }
  jacobian_.resize(Dim * Dim * lattice.sites());
  jacobian_dual_.resize(jacobian_.size());
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::jacobians(const T* displacement) {
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
      T* F = jacobian_.data() + Dim * Dim * site;
      for (int axis = 0; axis < Dim; ++axis) {
        T column[Dim];
        SideDifferences<Dim, Dim, T>(lattice_, index, site, stride_[axis], axis, displacement,
                                     static_cast<T>(1 / lattice_.spacing[axis]))
            .combine(column);
        for (int row = 0; row < Dim; ++row) F[Dim * row + axis] = column[row] + (row == axis ? T(1) : T(0));
      }
    });
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::push(const T* displacement, const T* zeroth, const T* first, T* zeroth_out,
                                      T* first_out) {
  const std::size_t field = Dim * lattice_.sites();
  jacobians(displacement);
  plan_.build(lattice_, displacement, lattice_);
  std::fill(zeroth_out, zeroth_out + field, T(0));
  if (!has_first_) {
    plan_.template add<Dim>(
        [&](const Index<Dim>& index, std::size_t site, std::array<T, Dim>& out) {
          const Site at(*this, index, site, zeroth, nullptr);
          if (!at.active) return false;
          const Column<Dim, T> pushed = at.zeroth();
          for (int c = 0; c < Dim; ++c) out[c] = pushed[c];
          return true;
        },
        zeroth_out);
    return;
  }
  // All orders of a site go out together, then are dealt to their fields.
  constexpr int channels = Dim + Dim * Dim;
  std::vector<T> together(channels * lattice_.sites(), T(0));
  plan_.template add<channels>(
      [&](const Index<Dim>& index, std::size_t site, std::array<T, channels>& out) {
        const Site at(*this, index, site, has_zeroth_ ? zeroth : nullptr, first);
        if (!at.active) return false;
        const Column<Dim, T> pushed = at.zeroth();
        for (int c = 0; c < Dim; ++c) out[c] = pushed[c];
        for (int b = 0; b < Dim; ++b) {
          const Column<Dim, T> turned = at.first_active ? at.first(b) : Column<Dim, T>(Column<Dim, T>::Zero());
          for (int c = 0; c < Dim; ++c) out[Dim + Dim * b + c] = turned[c];
        }
        return true;
      },
      together.data());
  const std::size_t sites = lattice_.sites();
#pragma omp parallel for schedule(static)
  for (std::size_t site = 0; site < sites; ++site)
    for (int c = 0; c < Dim; ++c) {
      zeroth_out[Dim * site + c] = together[channels * site + c];
      for (int b = 0; b < Dim; ++b)
        first_out[b * field + Dim * site + c] = together[channels * site + Dim + Dim * b + c];
    }
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::push_adjoint(const T* displacement, const T* zeroth, const T* first,
                                              const T* zeroth_out_dual, const T* first_out_dual, T* displacement_dual,
                                              T* zeroth_dual, T* first_dual) {
  const std::size_t field = Dim * lattice_.sites();
  jacobians(displacement);
  std::fill(jacobian_dual_.begin(), jacobian_dual_.end(), T(0));
  const T* first_in = has_first_ ? first : nullptr;
  const T* zeroth_in = has_zeroth_ ? zeroth : nullptr;

  for_planes_apart(lattice_.size[Dim - 1], [&](int slab) {
    visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
      const Site at(*this, index, site, zeroth_in, first_in);
      const LinearCell<Dim, T> cell(lattice_, displaced<Dim, T>(lattice_, index, displacement + Dim * site, lattice_));
      const auto gather = [&](const T* dual_field) {
        const std::array<T, Dim> value = cell.template value<Dim>(dual_field);
        Column<Dim, T> column;
        for (int c = 0; c < Dim; ++c) column[c] = value[c];
        return column;
      };
      const Column<Dim, T> dual0 = gather(zeroth_out_dual);
      const Column<Dim, T> s_dual = at.G.transpose() * dual0;
      if (has_zeroth_) add<Dim, T>(zeroth_dual + Dim * site, s_dual);

      Square<Dim, T> G_dual = dual0 * at.s.transpose();
      Square<Dim, T> F_dual = Square<Dim, T>::Zero();
      std::array<T, Dim> position_dual{};
      const auto add_position = [&](const T* dual_field, const Column<Dim, T>& pushed) {
        std::array<T, Dim> values;
        for (int c = 0; c < Dim; ++c) values[c] = pushed[c];
        const std::array<T, Dim> gradient = cell.template pulled_back_gradient<Dim>(dual_field, values);
        for (int a = 0; a < Dim; ++a) position_dual[a] += gradient[a];
      };
      if (at.active) add_position(zeroth_out_dual, at.zeroth());

      if (has_first_) {
        for (int b = 0; b < Dim; ++b) {
          const Column<Dim, T> dual = gather(first_out_dual + b * field);
          const Column<Dim, T> p_dual = at.G.transpose() * dual;
          for (int c = 0; c < Dim; ++c) {
            add<Dim, T>(first_dual + c * field + Dim * site, Column<Dim, T>(at.F(b, c) * p_dual));
            if (at.first_active) F_dual(b, c) += p_dual.dot(at.m[c]);
          }
          // The dependence of m_0' on m_b goes through d_b F, which exists at every site.
          Square<Dim, T> derivative;
          if (at.first_active) {
            derivative = at.dF[b];
          } else {
            T values[Dim * Dim];
            SideDifferences<Dim * Dim, Dim, T>(lattice_, index, site, stride_[b], b, jacobian_.data(), T(1)).combine(values);
            derivative = load_matrix<Dim, T>(values) / static_cast<T>(lattice_.spacing[b]);
          }
          const Column<Dim, T> n_dual = unit_ * (derivative * s_dual);
          add<Dim, T>(first_dual + b * field + Dim * site, Column<Dim, T>(at.G.transpose() * n_dual));
          if (!at.first_active) continue;
          G_dual += dual * at.p[b].transpose() + n_dual * at.m[b].transpose();
          add_position(first_out_dual + b * field, at.first(b));
          const Square<Dim, T> derivative_dual =
              (unit_ / static_cast<T>(lattice_.spacing[b])) * (at.n[b] * s_dual.transpose());
          SideDifferences<Dim * Dim, Dim, T>(lattice_, index, site, stride_[b], b, jacobian_.data(), T(1))
              .adjoint(derivative_dual.data(), site, stride_[b], T(1), jacobian_dual_.data());
        }
      }
      if (!at.active) return;
      F_dual -= at.G * G_dual.transpose() * at.G;
      T* sum = jacobian_dual_.data() + Dim * Dim * site;
      for (int k = 0; k < Dim * Dim; ++k) sum[k] += F_dual.data()[k];
      for (int a = 0; a < Dim; ++a)
        displacement_dual[Dim * site + a] += position_dual[a] / static_cast<T>(lattice_.spacing[a]);
    });
  });

  for_planes_apart(lattice_.size[Dim - 1], [&](int slab) {
    visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
      const T* F_dual = jacobian_dual_.data() + Dim * Dim * site;
      if (is_zero<Dim * Dim, T>(F_dual)) return;
      for (int axis = 0; axis < Dim; ++axis) {
        T column[Dim];
        for (int row = 0; row < Dim; ++row) column[row] = F_dual[Dim * row + axis];
        const T scale = static_cast<T>(1 / lattice_.spacing[axis]);
        SideDifferences<Dim, Dim, T>(lattice_, index, site, stride_[axis], axis, displacement, scale)
            .adjoint(column, site, stride_[axis], scale, displacement_dual);
      }
    });
  });
}

template <int Dim, class T>
void CoadjointTransport<Dim, T>::pull_back(const T* displacement, const T* field, T scale, T* sum) {
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
      const Square<Dim, T> F = load_matrix<Dim, T>(jacobian_.data() + Dim * Dim * site);
      const LinearCell<Dim, T> cell(lattice_, displaced<Dim, T>(lattice_, index, displacement + Dim * site, lattice_));
      const std::array<T, Dim> value = cell.template value<Dim>(field);
      Column<Dim, T> column;
      for (int c = 0; c < Dim; ++c) column[c] = value[c];
      add<Dim, T>(sum + Dim * site, Column<Dim, T>(scale * (F.inverse() * column)));
    });
}

template class CoadjointTransport<2, float>;
template class CoadjointTransport<3, float>;
template class CoadjointTransport<2, double>;
template class CoadjointTransport<3, double>;

}  // namespace saltus
