#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

namespace saltus {

// For sources of the core alone: what is compiled for another processor sees other registers.

/// The widest register of the processor that is compiled for. Loops that the compiler puts into lanes by itself are
/// left to it; loops whose sums must not leave the registers say so with these.
#ifdef __AVX512F__
constexpr std::size_t kRegisterBytes = 64;
#else
constexpr std::size_t kRegisterBytes = 32;
#endif
template <class T>
constexpr std::size_t kRegisterLanes = kRegisterBytes / sizeof(T);

/// Whether the processor has registers of that width. Where it has not, compilers may put together one value after the
/// other what is to be shuffled between two, which loops over values do better.
#ifdef __AVX__
constexpr bool kHasRegisters = true;
#else
constexpr bool kHasRegisters = false;
#endif

template <class T>
struct RegisterOf {
  typedef T Type __attribute__((vector_size(kRegisterBytes)));
};
template <class T>
using Register = typename RegisterOf<T>::Type;

template <class T>
[[gnu::always_inline]] inline Register<T> load(const T* from) {
  Register<T> values;
  std::memcpy(&values, from, sizeof values);
  return values;
}
template <class T>
[[gnu::always_inline]] inline void store(const Register<T>& values, T* to) {
  std::memcpy(to, &values, sizeof values);
}

/// To a multiple of kRegisterBytes, past the caches where the processor can: what will not be read again soon then
/// needs not be fetched first. Other threads may read it after a std::atomic_thread_fence.
template <class T>
[[gnu::always_inline]] inline void store_far(const Register<T>& values, T* to) {
#if defined(__has_builtin) && __has_builtin(__builtin_nontemporal_store)
  __builtin_nontemporal_store(values, reinterpret_cast<Register<T>*>(to));
#elif defined(__AVX512F__) && __has_builtin(__builtin_ia32_movntdq512)
  typedef long long Bits __attribute__((vector_size(64), may_alias));
  __builtin_ia32_movntdq512(reinterpret_cast<Bits*>(to), reinterpret_cast<const Bits&>(values));
#elif defined(__AVX__) && __has_builtin(__builtin_ia32_movntdq256)
  typedef long long Bits __attribute__((vector_size(32), may_alias));
  __builtin_ia32_movntdq256(reinterpret_cast<Bits*>(to), reinterpret_cast<const Bits&>(values));
#else
  store<T>(values, to);
#endif
}

/// The first `count` values alone, or all if that is more; no other is read or written.
#if defined(__AVX512F__) && defined(__has_builtin) && __has_builtin(__builtin_ia32_loadups512_mask) && \
    __has_builtin(__builtin_ia32_storeups512_mask)
template <class T>
[[gnu::always_inline]] inline unsigned first_lanes(std::size_t count) {
  return count < kRegisterLanes<T> ? (1u << count) - 1 : (1u << kRegisterLanes<T>)-1;
}
template <class T>
[[gnu::always_inline]] inline Register<T> load_first(std::size_t count, const T* from, T other) {
  const unsigned lanes = first_lanes<T>(count);
  if constexpr (sizeof(T) == 4)
    return __builtin_ia32_loadups512_mask(from, Register<T>{} + other, static_cast<unsigned short>(lanes));
  else
    return __builtin_ia32_loadupd512_mask(from, Register<T>{} + other, static_cast<unsigned char>(lanes));
}
template <class T>
[[gnu::always_inline]] inline void store_first(std::size_t count, const Register<T>& values, T* to) {
  const unsigned lanes = first_lanes<T>(count);
  if constexpr (sizeof(T) == 4)
    __builtin_ia32_storeups512_mask(to, values, static_cast<unsigned short>(lanes));
  else
    __builtin_ia32_storeupd512_mask(to, values, static_cast<unsigned char>(lanes));
}
#else
template <class T>
[[gnu::always_inline]] inline Register<T> load_first(std::size_t count, const T* from, T other) {
  if (count >= kRegisterLanes<T>) return load(from);
  T lanes[kRegisterLanes<T>];
  for (std::size_t i = 0; i < kRegisterLanes<T>; ++i) lanes[i] = i < count ? from[i] : other;
  return load(lanes);
}
template <class T>
[[gnu::always_inline]] inline void store_first(std::size_t count, const Register<T>& values, T* to) {
  if (count >= kRegisterLanes<T>) return store<T>(values, to);
  for (std::size_t i = 0; i < count; ++i) to[i] = values[i];
}
#endif

/// By set of eight words (a bit for each): which words are in it, rising, four bits for each.
inline constexpr std::array<std::uint32_t, 256> kWordsOfSet = [] {
  std::array<std::uint32_t, 256> words{};
  for (unsigned set = 0; set < 256; ++set)
    for (unsigned word = 0, at = 0; word < 8; ++word)
      if (set >> word & 1) words[set] |= word << 4 * at++;
  return words;
}();

/// Some of a register's lanes: those where a comparison of it holds.
template <class T>
class PickedLanes {
  using Whole = decltype(Register<T>{} < Register<T>{});

 public:
#if defined(__AVX512F__) && defined(__has_builtin) && __has_builtin(__builtin_ia32_compresssf512_mask)
  [[gnu::always_inline]] explicit PickedLanes(const Whole& holds) {
    typedef int Words __attribute__((vector_size(64)));
    typedef long long Longs __attribute__((vector_size(64)));
    if constexpr (sizeof(T) == 4)
      lanes_ = __builtin_ia32_cmpd512_mask((Words)holds, Words{}, 1, 0xffff);  // 1: less
    else
      lanes_ = __builtin_ia32_cmpq512_mask((Longs)holds, Longs{}, 1, 0xff);
  }
  int count() const { return __builtin_popcount(lanes_); }
  /// Their values, one after the other; what lies behind them, up to as many as a register holds, may change.
  template <class V>
  [[gnu::always_inline]] void store(const V& values, void* to) const {
    V packed;
    if constexpr (sizeof(T) == 4) {
      typedef float Floats __attribute__((vector_size(64)));
      packed = (V)__builtin_ia32_compresssf512_mask((Floats)values, Floats{}, static_cast<unsigned short>(lanes_));
    } else {
      typedef double Doubles __attribute__((vector_size(64)));
      packed = (V)__builtin_ia32_compressdf512_mask((Doubles)values, Doubles{}, static_cast<unsigned char>(lanes_));
    }
    std::memcpy(to, &packed, sizeof packed);
  }

 private:
  unsigned lanes_;
#elif defined(__AVX2__) && !defined(__AVX512F__) && defined(__has_builtin) && \
    __has_builtin(__builtin_ia32_permvarsf256) && __has_builtin(__builtin_ia32_movmskps256)
  typedef float Floats __attribute__((vector_size(32)));
  typedef int Words __attribute__((vector_size(32)));

  [[gnu::always_inline]] explicit PickedLanes(const Whole& holds)
      : words_(static_cast<unsigned>(__builtin_ia32_movmskps256((Floats)holds))) {}
  int count() const { return std::popcount(words_) / static_cast<int>(sizeof(T) / sizeof(float)); }
  /// Their values, one after the other; what lies behind them, up to as many as a register holds, may change.
  template <class V>
  [[gnu::always_inline]] void store(const V& values, void* to) const {
    // Of an index the instruction sees the lowest three bits.
    const Words order = (Words{} + static_cast<int>(kWordsOfSet[words_])) >> Words{0, 4, 8, 12, 16, 20, 24, 28};
    const Floats packed = __builtin_ia32_permvarsf256((Floats)values, order);
    std::memcpy(to, &packed, sizeof packed);
  }

 private:
  unsigned words_;  // a bit for each four bytes
#else
  [[gnu::always_inline]] explicit PickedLanes(const Whole& holds) {
    for (std::size_t i = 0; i < kRegisterLanes<T>; ++i) holds_[i] = static_cast<int>(-holds[i]);
  }
  int count() const {
    int count = 0;
    for (int holds : holds_) count += holds;
    return count;
  }
  /// Their values, one after the other; what lies behind them, up to as many as a register holds, may change.
  template <class V>
  [[gnu::always_inline]] void store(const V& values, void* to) const {
    T lanes[kRegisterLanes<T>], packed[kRegisterLanes<T>];
    std::memcpy(lanes, &values, sizeof lanes);
    for (std::size_t i = 0, at = 0; i < kRegisterLanes<T>; ++i) {
      packed[at] = lanes[i];
      at += static_cast<std::size_t>(holds_[i]);
    }
    std::memcpy(to, packed, sizeof packed);
  }

 private:
  int holds_[kRegisterLanes<T>];
#endif
};

template <int By, class T, int... Lane>
[[gnu::always_inline]] inline Register<T> shifted_lanes(const Register<T>& low, const Register<T>& high,
                                                        std::integer_sequence<int, Lane...>) {
  return __builtin_shufflevector(low, high, (Lane + By)...);
}
/// Of the lanes of both, one after the other, those from `By` on: `high` itself where that is all of `low`.
template <int By, class T>
[[gnu::always_inline]] inline Register<T> shifted(const Register<T>& low, const Register<T>& high) {
  constexpr int lanes = static_cast<int>(kRegisterLanes<T>);
  static_assert(0 <= By && By <= lanes);
  if constexpr (By == lanes) {
    return high;
  } else {
#if defined(__AVX512F__) && defined(__has_builtin) && __has_builtin(__builtin_ia32_alignd512_mask)
    // The compiler would take an instruction for any order of lanes, which is slower and needs that order in a
    // register.
    typedef int Words __attribute__((vector_size(64)));
    constexpr int words = By * static_cast<int>(sizeof(T) / sizeof(int));
    return (Register<T>)__builtin_ia32_alignd512_mask((Words)high, (Words)low, words, Words{}, 0xffff);
#else
    return shifted_lanes<By, T>(low, high, std::make_integer_sequence<int, lanes>());
#endif
  }
}

/// Sum of the lanes: halves are added, then halves of these, and so on.
template <class T, int Lanes = static_cast<int>(kRegisterLanes<T>)>
[[gnu::always_inline]] inline T sum_of(const Register<T>& lanes) {
  if constexpr (Lanes == 1) {
    return lanes[0];
  } else if constexpr (kHasRegisters) {
    return sum_of<T, Lanes / 2>(lanes + shifted<Lanes / 2, T>(lanes, lanes));
  } else {
    Register<T> halves = lanes;
    for (int i = 0; i < Lanes / 2; ++i) halves[i] += lanes[i + Lanes / 2];
    return sum_of<T, Lanes / 2>(halves);
  }
}

template <int From, class T, int... Lane>
[[gnu::always_inline]] inline Register<T> every_second_lane(const Register<T>& low, const Register<T>& high,
                                                            std::integer_sequence<int, Lane...>) {
  return __builtin_shufflevector(low, high, (2 * Lane + From)...);
}
/// Of the lanes of both, one after the other, every second one from `From` on.
template <int From, class T>
[[gnu::always_inline]] inline Register<T> every_second(const Register<T>& low, const Register<T>& high) {
  return every_second_lane<From, T>(low, high, std::make_integer_sequence<int, static_cast<int>(kRegisterLanes<T>)>());
}
template <int Half, class T, int... Lane>
[[gnu::always_inline]] inline Register<T> doubled_lanes(const Register<T>& values,
                                                        std::integer_sequence<int, Lane...>) {
  return __builtin_shufflevector(values, values, (static_cast<int>(sizeof...(Lane)) / 2 * Half + Lane / 2)...);
}
/// The lanes of the first (0) or second half, each twice.
template <int Half, class T>
[[gnu::always_inline]] inline Register<T> doubled(const Register<T>& values) {
  return doubled_lanes<Half, T>(values, std::make_integer_sequence<int, static_cast<int>(kRegisterLanes<T>)>());
}

/// What of interleaved vectors a register holds, and where that goes: `Of` tells the lane of `low` and `high`, one
/// after the other, that each lane takes.
template <class Of, class T, int... Lane>
[[gnu::always_inline]] inline Register<T> picked_lanes(const Register<T>& low, const Register<T>& high,
                                                       std::integer_sequence<int, Lane...>) {
  return __builtin_shufflevector(low, high, (Of::of(Lane))...);
}
template <class Of, class T>
[[gnu::always_inline]] inline Register<T> picked(const Register<T>& low, const Register<T>& high) {
  return picked_lanes<Of, T>(low, high, std::make_integer_sequence<int, static_cast<int>(kRegisterLanes<T>)>());
}

/// Vectors of two or three values, as many as a register has lanes: from memory to a register for each component, and
/// back.
template <int Channels, class T>
class Interleaved {
  static_assert(Channels == 2 || Channels == 3);
  static constexpr int kLanes = static_cast<int>(kRegisterLanes<T>);

 public:
  [[gnu::always_inline]] static void load(const T* from, Register<T> (&components)[Channels]) {
    const Register<T> first = saltus::load(from), second = saltus::load(from + kLanes);
    if constexpr (Channels == 2) {
      components[0] = every_second<0, T>(first, second);
      components[1] = every_second<1, T>(first, second);
    } else {
      const Register<T> third = saltus::load(from + 2 * kLanes);
      components[0] = picked<Rest<0>, T>(picked<Component<0>, T>(first, second), third);
      components[1] = picked<Rest<1>, T>(picked<Component<1>, T>(first, second), third);
      components[2] = picked<Rest<2>, T>(picked<Component<2>, T>(first, second), third);
    }
  }
  [[gnu::always_inline]] static void store(const Register<T> (&components)[Channels], T* to) {
    put<0>(components, to);
    put<1>(components, to);
    if constexpr (Channels == 3) put<2>(components, to);
  }

 private:
  /// Component C of three as far as two registers have it, and what the third one adds to that.
  template <int C>
  struct Component {
    static constexpr int of(int lane) { return (3 * lane + C) % (2 * kLanes); }
  };
  template <int C>
  struct Rest {
    static constexpr int of(int lane) {
      const int value = 3 * lane + C;
      return value < 2 * kLanes ? lane : value - kLanes;
    }
  };
  /// Of the values of register R those of two components, and what the third one adds to that.
  template <int R>
  struct Two {
    static constexpr int of(int lane) {
      const int value = R * kLanes + lane, site = value / Channels, component = value % Channels;
      return component == 1 ? kLanes + site : site;
    }
  };
  template <int R>
  struct Third {
    static constexpr int of(int lane) {
      const int value = R * kLanes + lane;
      return value % Channels == 2 ? kLanes + value / Channels : lane;
    }
  };
  template <int R>
  [[gnu::always_inline]] static void put(const Register<T> (&components)[Channels], T* to) {
    Register<T> values = picked<Two<R>, T>(components[0], components[1]);
    if constexpr (Channels == 3) values = picked<Third<R>, T>(values, components[2]);
    saltus::store<T>(values, to + R * kLanes);
  }
};

template <class T>
[[gnu::always_inline]] inline Register<T> square_root(const Register<T>& values) {
  T lanes[kRegisterLanes<T>];  // which the compiler sees through
  store<T>(values, lanes);
  for (T& lane : lanes) lane = std::sqrt(lane);
  return load(lanes);
}

}  // namespace saltus
