#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Linear interpolation of an interleaved field from one lattice to another, axis by axis, and its exact transpose.
/// Points of `target` outside `source` take the border's value.
template <int Dim, class T>
class LatticeInterpolation {
 public:
  LatticeInterpolation(const Lattice<Dim>& source, const Lattice<Dim>& target, int channels);

  /// target += P source.
  void add_to(const T* source, T* target);
  /// target = P source.
  void take(const T* source, T* target);
  /// source = P^T target.
  void transpose(const T* target, T* source);

  bool is_identity() const { return identity_; }

 private:
  struct Tap {
    int low;     ///< source index
    T fraction;  ///< weight of low + 1
  };
  template <bool is_added>
  void resize(const T* source, T* target);
  template <bool is_added>
  void resize_axis(int axis, const Index<Dim>& size, const T* in, T* out) const;
  void transpose_axis(int axis, const Index<Dim>& size, const T* in, T* out) const;

  Lattice<Dim> source_, target_;
  int channels_;
  bool identity_;
  std::array<std::vector<Tap>, Dim> taps_;   ///< by target index
  std::array<std::vector<int>, Dim> first_;  ///< by source index: the first target whose tap is not below it
  std::vector<T> scratch_[2];
};

}  // namespace saltus
