#include "core/support/ranking.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include "tests/support/many_threads.h"

namespace saltus {
namespace {

/// Of both signs and of all sizes, many of them several times.
template <class T>
std::vector<T> numbers(std::size_t count) {
  std::mt19937_64 bits(count);
  std::vector<T> list(count);
  for (T& number : list) {
    number = static_cast<T>(std::ldexp(static_cast<double>(bits() % 1000) - 500, static_cast<int>(bits() % 60) - 30));
    if (bits() % 4 == 0) number = 7;
    if (bits() % 50 == 0) number = std::numeric_limits<T>::infinity() * (bits() % 2 ? 1 : -1);
  }
  return list;
}

template <class T>
class RankingOf : public ::testing::Test {};
using Types = ::testing::Types<float, double>;
TYPED_TEST_SUITE(RankingOf, Types);

// Oracle: std::sort.
TYPED_TEST(RankingOf, IsThePlaceInTheSortedList) {
  const testing::ManyThreads many;
  for (std::size_t count : {1u, 2u, 3u, 100u, 5000u})
    for (int threads : {1, 3}) {
      omp_set_num_threads(threads);
      std::vector<TypeParam> list = numbers<TypeParam>(count);
      const auto ranking = ranking_of(count, list.data());
      EXPECT_EQ(ranking.count(), count);
      std::vector<TypeParam> sorted = list;
      std::sort(sorted.begin(), sorted.end());
      for (std::size_t rank = 0; rank < count; rank += 1 + count / 50)
        ASSERT_EQ(ranking.at(rank), sorted[rank]) << rank << " of " << count;
      ASSERT_EQ(ranking.at(count - 1), sorted.back());
    }
}

TYPED_TEST(RankingOf, TakesOnlyWhatThereIs) {
  std::vector<TypeParam> list = numbers<TypeParam>(1000), kept;
  for (std::size_t i = 0; i < list.size(); ++i)
    if (i % 3 == 0)
      kept.push_back(list[i]);
    else
      list[i] = std::numeric_limits<TypeParam>::quiet_NaN();
  const auto ranking = ranking_of_those<TypeParam>(list.size(), [&](std::size_t i, const auto& take) {
    if (i % 3 == 0) take(list[i]);
  });
  std::sort(kept.begin(), kept.end());
  ASSERT_EQ(ranking.count(), kept.size());
  for (std::size_t rank : {std::size_t(0), kept.size() / 2, kept.size() - 1}) EXPECT_EQ(ranking.at(rank), kept[rank]);
  EXPECT_EQ(ranking_of_those<TypeParam>(10, [](std::size_t, const auto&) {}).count(), 0u);
}

TYPED_TEST(RankingOf, TellsNumbersApartThatDifferInTheLastBit) {
  std::vector<TypeParam> list;
  for (TypeParam number = -1; list.size() < 40; number = std::nextafter(number, TypeParam(0))) list.push_back(number);
  const std::vector<TypeParam> sorted = list;
  std::shuffle(list.begin(), list.end(), std::mt19937(1));
  const auto ranking = ranking_of(list.size(), list.data());
  for (std::size_t rank = 0; rank < list.size(); ++rank) EXPECT_EQ(ranking.at(rank), sorted[rank]) << rank;
}

}  // namespace
}  // namespace saltus
