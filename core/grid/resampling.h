#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Linear interpolation of an interleaved field from one lattice to another, and its exact transpose. Points of
/// `target` outside `source` take the border's value. One axis after the other: the last one, across planes which each
/// stay in the caches, so that a whole target is only made where the caller wants one; then x, whose rows are few as
/// long as y is the source's; then y, along rows of the target.
template <int Dim, class T>
class LatticeInterpolation {
 public:
  LatticeInterpolation(const Lattice<Dim>& source, const Lattice<Dim>& target, int channels);

  /// target += P source.
  void add_to(const T* source, T* target) const;
  /// source = P^T target.
  void transpose(const T* target, T* source);

  bool is_identity() const { return identity_; }

  // The same plane by plane, each from any thread. Not where this is the identity.

  /// What a thread works with; one for as many calls as it likes.
  using Scratch = std::array<std::vector<T>, 2>;
  /// out = plane number `plane` of P source.
  void take_plane(const T* source, int plane, Scratch& scratch, T* out) const;
  /// source = P^T of planes: begin, take in each of them once, finish.
  void begin_transpose();
  void transpose_plane(const T* values, int plane, Scratch& scratch);
  void finish_transpose(T* source) const;

 private:
  struct Tap {
    int low;     ///< source index
    T fraction;  ///< weight of low + 1
  };
  /// What the transpose brings to a source index: of the targets begin .. end - 1, the shares from `share` on.
  struct Gathering {
    int begin, end;
    std::size_t share;
  };
  template <bool is_added, class Channels>
  void resize_plane(const T* source, int plane, Scratch& scratch, T* out, Channels channels) const;
  template <bool is_added, class Inner>
  void resize_axis(int axis, std::size_t outer, Inner inner, const T* in, T* out) const;
  void resize_rows_of_3(std::size_t rows, const T* in, T* out) const;
  template <class Inner>
  void transpose_axis(int axis, std::size_t outer, Inner inner, const T* in, T* out) const;
  void transpose_rows_of_3(std::size_t rows, const T* in, T* out) const;

  Lattice<Dim> source_, target_;
  int channels_;
  bool identity_;
  std::array<std::vector<Tap>, Dim> taps_;              ///< by target index
  std::array<std::vector<Gathering>, Dim> gatherings_;  ///< by source index
  std::array<std::vector<T>, Dim> shares_;              ///< of the gatherings
  std::size_t source_plane_, target_plane_;             ///< scalars
  std::vector<T> reduced_;                              ///< planes transposed along all axes but the last
};

}  // namespace saltus
