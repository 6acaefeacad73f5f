#pragma once

#include "core/grid/block_mask.h"
#include "core/kernels/mirrored_sums.h"
#include "core/kernels/separable_convolution.h"
#include "core/support/line_vector.h"
#include "core/support/thread_count.h"

#include <algorithm>

namespace saltus {

/// Values side by side in a column of blocks along one axis, and registers that hold a row of them.
template <int Dim>
constexpr int kColumnValues = Dim*(Dim == 3 ? kBlockEdge * kBlockEdge : kBlockEdge);
template <int Dim, class T>
constexpr int kColumnRegisters = (kColumnValues<Dim> - 1) / static_cast<int>(kRegisterLanes<T>) + 1;
template <int Dim, class T>
constexpr int kColumnLanes = kColumnRegisters<Dim, T>* static_cast<int>(kRegisterLanes<T>);

/// The lines of one column of blocks: `pieces` of `piece` neighbouring scalars in every row.
template <int Dim, class T>
struct ColumnPlace {
  int pieces = 0, piece = 0;
  std::size_t row_stride = 0;
  std::array<std::size_t, kBlockEdge * kBlockEdge> piece_at{};  ///< from the row's first scalar
  std::array<int, kBlockEdge * kBlockEdge> lane_at{};

  void read(const T* field, int begin, int end, T* lanes) const {
    each(begin, end, [&](std::size_t at, std::size_t lane, auto length) {
      std::copy_n(field + at, static_cast<int>(length), lanes + lane);
    });
  }
  void write(const T* lanes, int begin, int end, T* field) const {
    each(begin, end, [&](std::size_t at, std::size_t lane, auto length) {
      std::copy_n(lanes + lane, static_cast<int>(length), field + at);
    });
  }

 private:
  template <class Copy>
  void each(int begin, int end, Copy&& copy) const {
    if (piece == Dim) return walk(begin, end, copy, std::integral_constant<int, Dim>());
    if (piece == Dim * kBlockEdge) return walk(begin, end, copy, std::integral_constant<int, Dim * kBlockEdge>());
    walk(begin, end, copy, piece);
  }
  template <class Copy, class Length>
  void walk(int begin, int end, Copy&& copy, Length length) const {
    for (int row = begin; row < end; ++row)
      for (int p = 0; p < pieces; ++p)
        copy(static_cast<std::size_t>(row) * row_stride + piece_at[static_cast<std::size_t>(p)],
             static_cast<std::size_t>(row) * kColumnLanes<Dim, T> + lane_at[static_cast<std::size_t>(p)], length);
  }
};

/// convolve_axis of an interleaved field with Dim channels that is given in the blocks of `in_blocks` only (0 outside)
/// and wanted in those of `out_blocks` only; nothing else is read or written. Columns of blocks are copied to where
/// their rows follow each other. A column belongs to one thread, and what is done to it depends on the masks alone.
template <int Dim, class T>
void convolve_block_columns(const Lattice<Dim>& lattice, int axis, const MirroredTaps<T>& taps, Combine combine,
                            const BlockMask<Dim>& in_at, const T* in, const BlockMask<Dim>& out_at, T* out) {
  if (out_at.is_empty()) return;
  constexpr int lanes = kColumnLanes<Dim, T>;
  const int radius = static_cast<int>(taps.reach());
  std::array<std::size_t, Dim> stride, block_stride;
  std::size_t sites = 1, blocks = 1;
  for (int a = 0; a < Dim; ++a) {
    stride[a] = sites;
    block_stride[a] = blocks;
    sites *= static_cast<std::size_t>(lattice.size[a]);
    blocks *= static_cast<std::size_t>(out_at.blocks()[a]);
  }
  const int length = lattice.size[axis], column_blocks = out_at.blocks()[axis];
  const int low = axis == 0 ? 1 : 0, high = Dim == 3 ? (axis == 2 ? 1 : 2) : low;  // the axes across
  const int low_blocks = out_at.blocks()[low], high_blocks = Dim == 3 ? out_at.blocks()[high] : 1;
#pragma omp parallel if (is_worth_threads(lattice.sites()))
  {
    // Rows beyond either end, as far as taps reach and as sums are made at once.
    const int rows = length + 2 * radius + kRowsAtOnce;
    LineVector<T> source_rows(static_cast<std::size_t>(rows) * lanes, T(0));
    LineVector<T> target(static_cast<std::size_t>(length + kRowsAtOnce) * lanes, T(0));
    T* source = source_rows.data() + radius * lanes;
#pragma omp for schedule(static) collapse(2)
    for (int h = 0; h < high_blocks; ++h)
      for (int l = 0; l < low_blocks; ++l) {
        std::size_t column = block_stride[low] * static_cast<std::size_t>(l);
        if (Dim == 3) column += block_stride[high] * static_cast<std::size_t>(h);
        const auto has_in = [&](int b) { return in_at[column + block_stride[axis] * static_cast<std::size_t>(b)]; };
        const auto has_out = [&](int b) { return out_at[column + block_stride[axis] * static_cast<std::size_t>(b)]; };

        ColumnPlace<Dim, T> place;
        bool is_placed = false;
        std::size_t at = 0;
        for (int b = 0; b < column_blocks; ++b) {
          if (!has_out(b)) continue;
          int end_block = b + 1;
          while (end_block < column_blocks && has_out(end_block)) ++end_block;
          const int out_begin = b * kBlockEdge, out_end = std::min(length, end_block * kBlockEdge);
          b = end_block;
          if (!is_placed) {
            is_placed = true;
            const int wide = std::min(kBlockEdge, lattice.size[low] - l * kBlockEdge);
            const int deep = Dim == 3 ? std::min(kBlockEdge, lattice.size[high] - h * kBlockEdge) : 1;
            at = Dim * stride[low] * static_cast<std::size_t>(l * kBlockEdge);
            if (Dim == 3) at += Dim * stride[high] * static_cast<std::size_t>(h * kBlockEdge);
            place.row_stride = Dim * stride[axis];
            place.piece = low == 0 ? Dim * wide : Dim;
            for (int d = 0; d < deep; ++d)
              for (int w = 0; w < (low == 0 ? 1 : wide); ++w) {
                const auto p = static_cast<std::size_t>(place.pieces++);
                place.piece_at[p] = Dim * (stride[low] * static_cast<std::size_t>(w));
                if (Dim == 3) place.piece_at[p] += Dim * stride[high] * static_cast<std::size_t>(d);
                place.lane_at[p] = Dim * (d * kBlockEdge + w);
              }
          }

          // Blocks that reach this run of outputs.
          const int first_block = std::max(0, out_begin - radius) / kBlockEdge;
          const int last_block = std::min(length - 1, out_end - 1 + radius) / kBlockEdge;
          int first_in = first_block, last_in = last_block;
          while (first_in <= last_in && !has_in(first_in)) ++first_in;
          while (last_in > first_in && !has_in(last_in)) --last_in;
          int begin = out_begin, end = out_begin;  // what receives anything
          if (first_in <= last_in) {
            const int in_begin = std::max(first_in * kBlockEdge, out_begin - radius);
            const int in_end = std::min({length, (last_in + 1) * kBlockEdge, out_end + radius});
            begin = std::max(out_begin, in_begin - radius);
            end = std::min(out_end, in_end + radius);
            const int from = begin - radius, to = end + radius;
            for (int row = from; row < to;) {
              const bool is_inside = row >= in_begin && row < in_end;
              const int block = row / kBlockEdge;
              int until = is_inside ? std::min(in_end, (block + 1) * kBlockEdge) : row < in_begin ? in_begin : to;
              until = std::min(until, to);
              if (is_inside && has_in(block))
                place.read(in + at, row, until, source);
              else
                std::fill(source + row * lanes, source + until * lanes, T(0));
              row = until;
            }
            if (combine == Combine::Add) place.read(out + at, begin, end, target.data());
            sum_mirrored<T>(
                taps, {(end - begin - 1) / kRowsAtOnce + 1, kColumnRegisters<Dim, T>, source + begin * lanes, lanes,
                       target.data() + begin * lanes, lanes, combine == Combine::Add});
          }
          if (combine == Combine::Replace) {
            std::fill(target.begin() + out_begin * lanes, target.begin() + begin * lanes, T(0));
            std::fill(target.begin() + end * lanes, target.begin() + out_end * lanes, T(0));
            place.write(target.data(), out_begin, out_end, out + at);
          } else {
            place.write(target.data(), begin, end, out + at);
          }
        }
      }
  }
}

}  // namespace saltus
