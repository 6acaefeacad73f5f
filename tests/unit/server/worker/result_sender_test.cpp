#include "server/worker/result_sender.h"

#include "client/lib/client_error.h"

#include <gtest/gtest.h>

#include <atomic>
#include <barrier>
#include <condition_variable>
#include <mutex>
#include <set>
#include <stdexcept>

namespace saltus::worker {
namespace {

const std::vector<std::string> kNames = {"a", "b", "c", "d", "e"};

client::FileDigest sent_as(std::size_t index) { return {"digest of " + kNames[index], static_cast<int>(index) + 1}; }

void wait_for_stop(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any changed;
  std::unique_lock lock(mutex);
  changed.wait(lock, stop, [] { return false; });
}

TEST(SendResults, SendsEachOnceAndTellsThemInTheirOrder) {
  std::mutex mutex;
  std::multiset<std::size_t> sent;
  const auto artifacts = send_results(kNames,
                                      [&](std::size_t index, const std::stop_token&) {
                                        const std::lock_guard lock(mutex);
                                        sent.insert(index);
                                        return sent_as(index);
                                      },
                                      {});
  EXPECT_EQ(sent, (std::multiset<std::size_t>{0, 1, 2, 3, 4}));
  ASSERT_EQ(artifacts.size(), kNames.size());
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    EXPECT_EQ(artifacts[i].name(), kNames[i]);
    EXPECT_EQ(artifacts[i].digest(), "digest of " + kNames[i]);
    EXPECT_EQ(artifacts[i].size(), static_cast<int>(i) + 1);
  }
}

// Neither could go on alone.
TEST(SendResults, SendsTwoAtATime) {
  std::barrier both(2);
  const std::vector<std::string> names = {"a", "b", "c", "d"};
  EXPECT_EQ(send_results(names,
                         [&](std::size_t index, const std::stop_token&) {
                           both.arrive_and_wait();
                           return sent_as(index);
                         },
                         {})
                .size(),
            4u);
}

TEST(SendResults, OneThatFailsStopsTheOtherAndIsWhatIsTold) {
  for (const std::size_t bad : {0u, 1u}) {
    std::barrier both(2);
    std::atomic<int> begun = 0;
    try {
      send_results(kNames,
                   [&](std::size_t index, const std::stop_token& stop) -> client::FileDigest {
                     ++begun;
                     both.arrive_and_wait();
                     if (index == bad) throw std::runtime_error("the first reason");
                     wait_for_stop(stop);
                     throw std::runtime_error("stopped");
                   },
                   {});
      ADD_FAILURE() << "nothing was thrown";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "the first reason");
    }
    EXPECT_EQ(begun, 2);
  }
}

TEST(SendResults, StopsWhenAsked) {
  std::stop_source source;
  std::barrier both(2, [&]() noexcept { source.request_stop(); });
  EXPECT_THROW(send_results(
                   kNames,
                   [&](std::size_t, const std::stop_token& stop) -> client::FileDigest {
                     both.arrive_and_wait();
                     wait_for_stop(stop);
                     throw std::runtime_error("stopped");
                   },
                   source.get_token()),
               std::runtime_error);
}

// Not with what has been sent until then, as if that were all.
TEST(SendResults, StopsWhereNoneIsOnItsWay) {
  for (const int before : {0, 2}) {
    std::stop_source source;
    if (before == 0) source.request_stop();
    std::atomic<int> sent = 0;
    try {
      send_results(
          kNames,
          [&](std::size_t index, const std::stop_token&) {
            if (++sent == before) source.request_stop();
            return sent_as(index);
          },
          source.get_token());
      ADD_FAILURE() << "nothing was thrown";
    } catch (const client::ClientError& error) {
      EXPECT_EQ(error.code(), grpc::StatusCode::CANCELLED);
    }
    EXPECT_LE(sent, before + 1);
  }
}

// All are there, so nothing was stopped.
TEST(SendResults, AStopAfterTheLastIsTooLate) {
  std::stop_source source;
  const std::vector<std::string> one = {"a"};
  const auto artifacts = send_results(
      one,
      [&](std::size_t index, const std::stop_token&) {
        source.request_stop();
        return sent_as(index);
      },
      source.get_token());
  ASSERT_EQ(artifacts.size(), 1u);
  EXPECT_EQ(artifacts[0].name(), "a");
}

TEST(SendResults, OfNothingAreNone) {
  EXPECT_TRUE(send_results({}, [](std::size_t, const std::stop_token&) { return client::FileDigest(); }, {}).empty());
}

}  // namespace
}  // namespace saltus::worker
