#pragma once

#include <cstddef>
#include <cstring>

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

}  // namespace saltus
