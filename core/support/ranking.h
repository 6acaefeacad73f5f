#pragma once

#include "core/support/thread_count.h"

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

namespace saltus {

/// Which of many numbers would be at a place if they were sorted; none is moved or kept. The places of numbers in bins
/// are counted digit by digit, the most significant ones first, in as many passes as a number has digits of 11 bits: 3
/// for float, 6 for double. -0 is before 0, and what is NaN beyond the infinity of its sign.
///
/// `values(i, take)` calls take(number) for what there is of candidate i, in [0, candidates): nothing or one number,
/// and the same at every call; by several threads at once.
template <class T, class Values>
class Ranking {
 public:
  Ranking(std::size_t candidates, Values values)
      : candidates_(candidates), values_(std::move(values)), first_(histogram(0, kBits, kBits - kDigit)) {
    for (std::size_t in_bin : first_) count_ += in_bin;
  }

  /// Numbers that there are.
  std::size_t count() const { return count_; }

  /// The number at place `rank`, counted from 0, which must be below count().
  T at(std::size_t rank) const {
    Key key = 0;
    Bins bins = first_;
    for (int known = kBits, shift = kBits - kDigit;; known = shift, shift = shift > kDigit ? shift - kDigit : 0) {
      if (known < kBits) bins = histogram(key, known, shift);
      std::size_t bin = 0;
      while (rank >= bins[bin]) rank -= bins[bin++];
      key |= static_cast<Key>(bin) << shift;
      if (shift == 0) return number(key);
    }
  }

 private:
  static_assert(std::is_same_v<T, float> || std::is_same_v<T, double>);
  using Key = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
  static constexpr int kBits = 8 * sizeof(T), kDigit = 11;
  static constexpr Key kSign = Key(1) << (kBits - 1);
  using Bins = std::array<std::size_t, std::size_t(1) << kDigit>;

  /// Sorted as numbers are: of negative ones all bits are turned over, of others the sign.
  static Key key_of(T number) {
    const Key bits = std::bit_cast<Key>(number);
    return bits & kSign ? ~bits : bits | kSign;
  }
  static T number(Key key) { return std::bit_cast<T>(key & kSign ? key ^ kSign : ~key); }

  /// Of the digit from bit `shift` up to bit `known`, of keys that have the bits of `key` from `known` on.
  Bins histogram(Key key, int known, int shift) const {
    const Key digit = (Key(1) << (known - shift)) - 1;
    Bins bins{};
#pragma omp parallel if (is_worth_threads(candidates_))
    {
      Bins own{};
      const auto take = [&](T number) {
        const Key other = key_of(number);
        if (known == kBits || (other ^ key) >> known == 0) ++own[other >> shift & digit];
      };
#pragma omp for schedule(static) nowait
      for (std::size_t i = 0; i < candidates_; ++i) values_(i, take);
#pragma omp critical(saltus_ranking)
      for (std::size_t bin = 0; bin < bins.size(); ++bin) bins[bin] += own[bin];
    }
    return bins;
  }

  std::size_t candidates_;
  Values values_;
  Bins first_;
  std::size_t count_ = 0;
};

/// Of the numbers `values[i]`.
template <class T>
auto ranking_of(std::size_t count, const T* values) {
  const auto all = [values](std::size_t i, const auto& take) { take(values[i]); };
  return Ranking<T, decltype(all)>(count, all);
}
/// Of what `values` takes, see Ranking.
template <class T, class Values>
auto ranking_of_those(std::size_t candidates, Values values) {
  return Ranking<T, Values>(candidates, std::move(values));
}

}  // namespace saltus
