#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <new>
#include <thread>
#include <vector>

#include <omp.h>
#include <sys/mman.h>
#include <unistd.h>

namespace {

// More than malloc ever keeps for later, so that all of it is new.
constexpr std::size_t kBytes = std::size_t{80} << 20;
constexpr std::align_val_t kLine{64};

/// Share of the whole pages of a block that there is memory behind.
double touched_share(void* block) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  const auto begin = (reinterpret_cast<std::uintptr_t>(block) + page - 1) / page * page;
  const std::size_t pages = (reinterpret_cast<std::uintptr_t>(block) + kBytes - begin) / page;
  std::vector<unsigned char> is_there(pages);
  EXPECT_EQ(::mincore(reinterpret_cast<void*>(begin), pages * page, is_there.data()), 0);
  const auto there = std::count_if(is_there.begin(), is_there.end(), [](unsigned char one) { return one & 1; });
  return static_cast<double>(there) / static_cast<double>(pages);
}

double touched_share_of_new() {
  void* block = ::operator new(kBytes);
  const double share = touched_share(block);
  ::operator delete(block);
  return share;
}

class FirstTouch : public ::testing::Test {
 protected:
  void TearDown() override { omp_set_num_threads(before_); }

 private:
  int before_ = omp_get_max_threads();
};

TEST_F(FirstTouch, ThreadsTouchLargeBlocks) {
  omp_set_num_threads(2);
  EXPECT_EQ(touched_share_of_new(), 1);
  void* block = ::operator new(kBytes, kLine);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(block) % 64, 0u);
  EXPECT_EQ(touched_share(block), 1);
  ::operator delete(block, kLine);
}

TEST_F(FirstTouch, OneThreadLeavesThemToWhoFillsThem) {
  omp_set_num_threads(1);
  EXPECT_LT(touched_share_of_new(), 0.5);
}

TEST_F(FirstTouch, OnlyTheFirstThreadHasATeam) {
  omp_set_num_threads(2);
  double share = 1;
  std::thread([&] { share = touched_share_of_new(); }).join();
  EXPECT_LT(share, 0.5);
}

TEST_F(FirstTouch, ALoopWithinALoopTouchesNothing) {
  omp_set_num_threads(2);
  double share = 1;
  for (const bool is_shared : {true, false}) {
#pragma omp parallel if (is_shared)
#pragma omp master
    share = touched_share_of_new();
    EXPECT_LT(share, 0.5) << is_shared;
  }
}

TEST_F(FirstTouch, AnyAlignmentIsGiven) {
  for (std::size_t alignment = 1; alignment <= 4096; alignment *= 2) {
    void* block = ::operator new (100, std::align_val_t{alignment});
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(block) % alignment, 0u) << alignment;
    ::operator delete (block, std::align_val_t{alignment});
  }
}

int calls = 0;
void give_up_at_the_third_call() {
  if (++calls == 3) std::set_new_handler(nullptr);
}

TEST_F(FirstTouch, WantOfMemoryIsToldAsTheStandardAsks) {
  volatile std::size_t most = PTRDIFF_MAX;
  const std::size_t bytes = most - 4096;
  void* block = nullptr;
  EXPECT_THROW(block = ::operator new(bytes), std::bad_alloc);
  EXPECT_THROW(block = ::operator new(bytes, kLine), std::bad_alloc);
  calls = 0;
  std::set_new_handler(give_up_at_the_third_call);
  EXPECT_THROW(block = ::operator new(bytes), std::bad_alloc);
  EXPECT_EQ(calls, 3);
  EXPECT_EQ(block, nullptr);
}

}  // namespace
