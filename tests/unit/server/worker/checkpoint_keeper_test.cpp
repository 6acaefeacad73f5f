#include "server/worker/checkpoint_keeper.h"

#include <gmock/gmock.h>

#include <condition_variable>
#include <mutex>
#include <stdexcept>

namespace saltus::worker {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::ElementsAre;

void forbidden() { ADD_FAILURE() << "made although none is due"; }

/// A clock that stands still unless told, and a place of safety that takes as long as the test wants.
class CheckpointKeeperTest : public testing::Test {
 protected:
  std::function<CheckpointKeeper::Clock::time_point()> clock() {
    return [this] { return now; };
  }
  CheckpointKeeper::Put put() {
    return [this](const std::stop_token& stop) {
      std::unique_lock lock(mutex);
      const std::string bytes = made;
      begun.push_back(bytes);
      changed.notify_all();
      changed.wait(lock, stop, [this] { return may_end > 0; });
      if (stop.stop_requested()) throw std::runtime_error("cut off");
      --may_end;
      if (bytes == "bad") throw std::runtime_error("no room");
    };
  }
  void wait_for_begin(std::size_t number) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return begun.size() >= number; });
  }
  void end_one() {
    std::lock_guard lock(mutex);
    ++may_end;
    changed.notify_all();
  }
  /// Offers until it is taken: the keeper's thread may not yet know that it is free.
  void offer_until_taken(CheckpointKeeper& keeper, const std::string& bytes) {
    for (bool is_taken = false; !is_taken; std::this_thread::yield())
      keeper.offer([&] {
        is_taken = true;
        made = bytes;
      });
  }

  CheckpointKeeper::Clock::time_point now{};
  std::mutex mutex;
  std::condition_variable_any changed;
  std::string made;  ///< last; nothing writes to it while it is put
  std::vector<std::string> begun;
  int may_end = 0;
  std::stop_source stop;
};

TEST_F(CheckpointKeeperTest, MakesOneForEachIntervalOnly) {
  may_end = 1000;
  CheckpointKeeper keeper(seconds(30), put(), stop.get_token(), clock());
  int times = 0;
  const auto make = [&] { made = std::to_string(++times); };
  keeper.offer(make);
  now += milliseconds(29999);
  keeper.offer(make);
  EXPECT_EQ(times, 0);
  now += milliseconds(1);
  keeper.offer(make);
  keeper.offer(make);
  EXPECT_EQ(times, 1);
  wait_for_begin(1);
  now += seconds(30);
  offer_until_taken(keeper, "second");
  wait_for_begin(2);
  EXPECT_THAT(begun, ElementsAre("1", "second"));
}

TEST_F(CheckpointKeeperTest, NeverHasTwoOnTheirWay) {
  CheckpointKeeper keeper(seconds(1), put(), stop.get_token(), clock());
  now += seconds(1);
  keeper.offer([this] { made = "first"; });
  wait_for_begin(1);
  now += seconds(100);
  keeper.offer(forbidden);
  EXPECT_EQ(keeper.kept(), 0);
  end_one();
  offer_until_taken(keeper, "second");
  EXPECT_EQ(keeper.kept(), 1);
}

TEST_F(CheckpointKeeperTest, WaitsLongerWhenMakingOneTakesLong) {
  may_end = 1000;
  CheckpointKeeper keeper(seconds(10), put(), stop.get_token(), clock());
  now += seconds(10);
  keeper.offer([this] {
    now += seconds(2);
    made = "slow";
  });
  wait_for_begin(1);
  now += seconds(37);  // 39 s from when the first began; one twentieth of 40 s is 2 s
  keeper.offer(forbidden);
  now += seconds(1);
  offer_until_taken(keeper, "next");
}

TEST_F(CheckpointKeeperTest, OneThatFailsIsNotCountedAndTheNextIsTried) {
  may_end = 1000;
  CheckpointKeeper keeper(seconds(1), put(), stop.get_token(), clock());
  now += seconds(1);
  keeper.offer([this] { made = "bad"; });
  wait_for_begin(1);
  for (const char* bytes : {"good", "good too"}) {
    now += seconds(1);
    offer_until_taken(keeper, bytes);
  }
  // The last was taken, so the one before it is safe.
  EXPECT_GE(keeper.kept(), 1);
  EXPECT_LE(keeper.kept(), 2);
}

TEST_F(CheckpointKeeperTest, OneThatCannotBeMadeIsNotPutAndTheNextIsTried) {
  may_end = 1000;
  CheckpointKeeper keeper(seconds(1), put(), stop.get_token(), clock());
  now += seconds(1);
  keeper.offer([] { throw std::runtime_error("no room"); });
  now += seconds(1);
  keeper.offer([this] { made = "next"; });
  wait_for_begin(1);
  EXPECT_THAT(begun, ElementsAre("next"));
}

TEST_F(CheckpointKeeperTest, AnIntervalOfZeroMakesNone) {
  CheckpointKeeper keeper(seconds(0), put(), stop.get_token(), clock());
  now += seconds(1000);
  keeper.offer(forbidden);
}

TEST_F(CheckpointKeeperTest, AStopCutsOffWhatIsOnItsWay) {
  CheckpointKeeper keeper(seconds(1), put(), stop.get_token(), clock());
  now += seconds(1);
  keeper.offer([this] { made = "first"; });
  wait_for_begin(1);
  stop.request_stop();
  // The destructor would wait for ever if the transfer went on.
}

}  // namespace
}  // namespace saltus::worker
