// Vectors that give up what they held.
#include "core/support/free_memory.h"

#include <gtest/gtest.h>

#include <vector>

namespace saltus {
namespace {

TEST(FreeVector, KeepsNoRoom) {
  std::vector<float> values(1000, 1.0f);
  free_vector(values);
  EXPECT_TRUE(values.empty());
  EXPECT_EQ(values.capacity(), 0u);
  values.resize(3);  // it is as good as new
  EXPECT_EQ(values, std::vector<float>(3));
}

}  // namespace
}  // namespace saltus
