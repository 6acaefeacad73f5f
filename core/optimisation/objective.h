#pragma once

#include <cstddef>
#include <vector>

namespace saltus {

/// Energy of the smooth part at a point. A non-finite energy is data, not an exception: the line search shortens.
struct Evaluation {
  double value = 0;
  bool is_valid = false;
};

/// weight * sum of factor_g |group g|_2 over groups of `group` consecutive values in [begin, end).
struct GroupSparsity {
  std::size_t begin = 0, end = 0;
  int group = 1;
  double weight = 0;
  double inverse_stiffness = 1;  ///< the preconditioner on this range
  std::vector<float> factors;    ///< one for each group; empty: 1 each. 0 leaves a group free, infinity keeps it at 0

  double weight_of(std::size_t index) const { return factors.empty() ? weight : weight * factors[index]; }
};

/// What became of a working set.
struct Revision {
  bool has_changed = false;
  double joined = 0;  ///< the share of a range of sparsity() that has just joined, of that with the largest
};

template <class T>
struct MinimiserState;

/// What `minimise` minimises: a smooth function plus group sparsity.
template <class T>
class Objective {
 public:
  virtual ~Objective() = default;
  virtual std::size_t size() const = 0;

  /// Value, gradient, and the gradient times a fixed positive definite approximation P of the inverse Hessian: of the
  /// unknowns outside the ranges of sparsity() alone, in their order. On a range P is its inverse stiffness. All
  /// vectors come in the right size.
  virtual Evaluation evaluate(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) = 0;

  /// As `evaluate`; but where the value has a kink at x, the gradient is the mean of what both sides have. Asked for
  /// where no step along the other one lowers the value.
  virtual Evaluation evaluate_between_sides(const std::vector<T>& x, std::vector<T>& gradient,
                                            std::vector<T>& preconditioned) {
    return evaluate(x, gradient, preconditioned);
  }

  /// An example of what noise in the data adds to the gradient at x, where the last evaluation was, and that
  /// preconditioned, both as there; about as much work. Forgets what that evaluation found outside the working set.
  /// False, and nothing written, where noise is not known.
  virtual bool noise_gradient(const std::vector<T>& /*x*/, std::vector<T>& /*gradient*/,
                              std::vector<T>& /*preconditioned*/) {
    return false;
  }

  /// Length of a sensible first step along `direction`.
  virtual double first_step(const std::vector<T>& direction) = 0;

  virtual const std::vector<GroupSparsity>& sparsity() const {
    static const std::vector<GroupSparsity> none;
    return none;
  }

  /// For objectives whose unknowns are a working set: whether there is anything outside it.
  virtual bool has_more() const { return false; }

  /// Whether the next evaluations have to find the gradient of what is outside the working set too. As long as this was
  /// never called, they do.
  virtual void look_everywhere(bool /*everywhere*/) {}

  /// Called at the start and after each accepted step, when the last evaluation was at state.x: may add unknowns at 0
  /// (when that evaluation looked everywhere), and may drop groups that are 0 in x and in every s of the pairs,
  /// from all vectors of the state alike. What is added has its own gradient, and 0 in the pairs. size() and sparsity()
  /// follow, and energies stay what they are.
  virtual Revision revise(MinimiserState<T>& /*state*/) { return {}; }
};

}  // namespace saltus
