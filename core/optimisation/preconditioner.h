#pragma once

#include "core/optimisation/lbfgs.h"
#include "core/optimisation/long_vectors.h"

#include <algorithm>

namespace saltus {

/// P, the preconditioner: a number on each sparsity range; elsewhere what the objective has made of a vector, which
/// comes with it as `dense` (see Objective::evaluate).
class Preconditioner {
 public:
  Preconditioner(const std::vector<GroupSparsity>& ranges, std::size_t size) {
    for (const GroupSparsity& range : ranges)
      if (range.begin < range.end) pieces_.push_back({range.begin, range.end, 0, range.inverse_stiffness, true});
    std::sort(pieces_.begin(), pieces_.end(), [](const Piece& a, const Piece& b) { return a.begin < b.begin; });
    std::size_t at = 0;
    for (std::size_t p = 0, ranged = pieces_.size(); p <= ranged; ++p) {
      const std::size_t next = p < ranged ? pieces_[p].begin : size;
      if (at < next) {
        pieces_.push_back({at, next, dense_size_, 1, false});
        dense_size_ += next - at;
      }
      if (p < ranged) at = pieces_[p].end;
    }
  }

  /// a . P a, of what lies outside the ranges
  template <class T>
  double dense_square(const std::vector<T>& a, const std::vector<T>& dense) const {
    double sum = 0;
    for (const Piece& piece : pieces_) {
      if (piece.is_range) continue;
      const T *left = a.data() + piece.begin, *right = dense.data() + piece.at;
      sum += ordered_sum(piece.end - piece.begin,
                         [&](std::size_t i) { return static_cast<double>(left[i]) * static_cast<double>(right[i]); });
    }
    return sum;
  }

  /// Length of the vectors called `dense`.
  std::size_t dense_size() const { return dense_size_; }

  /// a . P b
  template <class T>
  double dot(const std::vector<T>& a, const std::vector<T>& b, const std::vector<T>& dense) const {
    double sum = 0;
    for (const Piece& piece : pieces_) {
      const T *left = a.data() + piece.begin, *right = piece.values(b, dense);
      sum += piece.factor * ordered_sum(piece.end - piece.begin, [&](std::size_t i) {
               return static_cast<double>(left[i]) * static_cast<double>(right[i]);
             });
    }
    return sum;
  }

  /// sum += P b
  template <class T>
  void add(const std::vector<T>& b, const std::vector<T>& dense, std::vector<T>& sum) const {
    for (const Piece& piece : pieces_)
      add_scaled(piece.factor, piece.end - piece.begin, piece.values(b, dense), sum.data() + piece.begin);
  }

  /// sum = scale (sum - alpha_k P y_k, the last pair first), in blocks that stay in the caches
  template <class T>
  void subtract(const std::deque<CurvaturePair<T>>& pairs, const std::vector<double>& alpha, T scale,
                std::vector<T>& sum) const {
    constexpr std::size_t most = 4096;
    for (const Piece& piece : pieces_) {
      const std::size_t blocks = (piece.end - piece.begin + most - 1) / most;
#pragma omp parallel for schedule(static) if (is_worth_threads(piece.end - piece.begin))
      for (std::size_t b = 0; b < blocks; ++b) {
        const std::size_t begin = b * most, count = std::min(most, piece.end - piece.begin - begin);
        T* values = sum.data() + piece.begin + begin;
        for (std::size_t k = pairs.size(); k-- > 0;) {
          const T f = static_cast<T>(-alpha[k] * piece.factor);
          const Stored<T>* y = piece.values(pairs[k].y, pairs[k].y_preconditioned) + begin;
#pragma omp simd
          for (std::size_t i = 0; i < count; ++i) values[i] += f * static_cast<T>(y[i]);
        }
#pragma omp simd
        for (std::size_t i = 0; i < count; ++i) values[i] *= scale;
      }
    }
  }

 private:
  struct Piece {
    std::size_t begin, end, at;  ///< `at`: where it begins in `dense`
    double factor;
    bool is_range;
    template <class T>
    const T* values(const std::vector<T>& b, const std::vector<T>& dense) const {
      return is_range ? b.data() + begin : dense.data() + at;
    }
  };
  std::vector<Piece> pieces_;
  std::size_t dense_size_ = 0;
};

}  // namespace saltus
