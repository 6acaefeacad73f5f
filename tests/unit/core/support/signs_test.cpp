#include "core/support/signs.h"

#include <gtest/gtest.h>

#include <limits>

namespace saltus {
namespace {

template <class T, int lanes>
void expect_lanes_to_be_numbers() {
  typedef T Register __attribute__((vector_size(lanes * sizeof(T))));
  const T values[] = {
      0, T(-0.0), 1, T(-1), T(2.5), T(-1e-30), std::numeric_limits<T>::infinity(), -std::numeric_limits<T>::max()};
  for (T size : values)
    for (T sign : values) {
      Register sizes{}, signs{};
      sizes[lanes - 1] = size;
      signs[lanes - 1] = sign;
      const Register magnitudes = magnitude(sizes);
      EXPECT_EQ(magnitudes[lanes - 1], std::abs(size));
      EXPECT_FALSE(std::signbit(magnitudes[lanes - 1]));
      const Register flipped = with_sign_flipped(sizes, signs), positive = positive_part(sizes);
      EXPECT_EQ(flipped[lanes - 1], std::signbit(sign) ? -size : size);
      EXPECT_EQ(flipped[lanes - 1], with_sign_flipped(size, sign));
      EXPECT_EQ(positive[lanes - 1], size > 0 ? size : 0);
      EXPECT_EQ(positive[lanes - 1], positive_part(size));
      EXPECT_EQ(positive[0], 0);
    }
}

TEST(Signs, AreTheSameInRegisters) {
  expect_lanes_to_be_numbers<float, 4>();
  expect_lanes_to_be_numbers<double, 2>();
  expect_lanes_to_be_numbers<float, 8>();
  expect_lanes_to_be_numbers<double, 4>();
  expect_lanes_to_be_numbers<float, 16>();
  expect_lanes_to_be_numbers<double, 8>();
}

}  // namespace
}  // namespace saltus
