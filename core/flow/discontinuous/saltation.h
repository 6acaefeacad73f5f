#pragma once

#include "core/flow/discontinuous/piecewise_velocity.h"

namespace saltus {

/// Filippov: the formulas below. Paper: as Bao et al. print them: crossing divides by n.v- + H_t (right where H is a
/// distance), sliding is I - n n^T (right where v+ - v- is parallel to n and the surface stands still).
enum class SaltationRule { Filippov, Paper };

/// Jump of the fundamental matrix where a motion meets a surface and goes on with velocity `after`,
///
///     S = I + (after - before) g^T / (g.before + H_t)  =  I + (after - before) n^T / (n.before - c)
///
/// for crossing (`after` is v of the other side) and for the start of sliding (`after` is the sliding velocity, and
/// then g^T S = 0). det S = (n.after - c) / (n.before - c). The divisor must not be 0.
template <int Dim>
Matrix<Dim> saltation(const SurfaceJet<Dim>& surface, const Vector<Dim>& before, const Vector<Dim>& after);

/// The same by a rule; `is_sliding` says which of the paper's two formulas is asked for.
template <int Dim>
Matrix<Dim> saltation(const SurfaceJet<Dim>& surface, const Vector<Dim>& before, const Vector<Dim>& after,
                      SaltationRule rule, bool is_sliding);

/// Filippov's motion along a surface,
///
///     v_s = a v+ + (1 - a) v-,   a = (n.v- - c) / (n.v- - n.v+),   so that n.v_s = c
///
/// and its Jacobian as a field around the surface, which takes level sets of H to level sets. The flow on both sides
/// must go into the surface (n.v- > c > n.v+); a is then in (0, 1).
template <int Dim>
struct SlidingMotion {
  double share_plus;  ///< a
  VelocityJet<Dim> velocity;
};
template <int Dim>
SlidingMotion<Dim> sliding_motion(const SurfaceJet<Dim>& surface, const VelocityJet<Dim>& minus,
                                  const VelocityJet<Dim>& plus);

}  // namespace saltus
