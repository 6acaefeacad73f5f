#pragma once

#include "core/grid/lattice.h"

#include <array>
#include <vector>

namespace saltus {

/// Where a velocity shows an interface along which something may slide, and which way that lies, from its structure
/// tensor: the mean of (D v)^T (D v) over a neighbourhood (two samples' standard deviation; 0 beyond the lattice),
/// whose first eigenvector is the direction n in which v changes most. Of a tangential jump a across n, D v is a n^T,
/// whichever way a points. Where v is smooth as well, it changes across what will be the interface before it can jump
/// there.
template <int Dim, class T>
class InterfaceNormals {
 public:
  /// `velocity` is interleaved, on `lattice`.
  InterfaceNormals(const Lattice<Dim>& lattice, const Field<T>& velocity);

  /// At the sites of another lattice over the same frame.
  struct Normals {
    /// Unit normals, Dim values a site, of either sign. 0 where v changes by less than three tenths of its strongest
    /// change.
    std::vector<T> values;
    /// How much v changes there, whatever way, as a share of the most within four sites along each axis: 1 where it
    /// changes most among its surroundings, even if by less than elsewhere, and less beside that; 0 where there is no
    /// normal. At the border of what lies within the lattice, which the least change for a normal does not know of.
    std::vector<T> strengths;  ///< empty unless asked for
    double oblique_share = 0;  ///< of the sites with a normal: those where it is more than 6 degrees off every axis
  };
  Normals on(const Lattice<Dim>& lattice, bool with_strengths = false) const;
  /// Makes normals that are no more than 6 degrees off an axis 0: there the momenta m_i jump better, since theirs lie
  /// between the samples.
  static void leave_out_axes(std::vector<T>& normals);

 private:
  static constexpr int kPairs = Dim * (Dim + 1) / 2;
  void make_shares(const Lattice<Dim>& lattice, std::vector<T>& strength) const;

  Lattice<Dim> lattice_;
  Field<T> tensor_;                              ///< upper triangle, row by row
  std::array<std::vector<double>, Dim> within_;  ///< share of the neighbourhood within the lattice, by index of an axis
};

}  // namespace saltus
