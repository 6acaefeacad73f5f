#pragma once

#include "saltus/v1/registration.grpc.pb.h"

#include <grpcpp/channel.h>

#include <atomic>
#include <exception>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace saltus::benchmark {

constexpr int kSubmitters = 32;  ///< threads that submit at the same time

/// "sha256:<hex>".
std::string digest_of(const std::string& data);

/// With a connection of its own.
std::shared_ptr<grpc::Channel> connect(const std::string& address);

/// Throws std::runtime_error when the call has failed.
void require(const grpc::Status& status, const char* what);

grpc::Status upload(v1::BlobService::Stub& stub, const std::string& data);

/// Runs `work(i)` for every i below `count` on several threads; throws what the first one that failed has thrown.
template <class Work>
void in_parallel(int count, Work work) {
  std::atomic<int> next{0};
  std::exception_ptr error;
  std::atomic_flag has_failed;
  {
    std::vector<std::jthread> threads;
    for (int t = 0; t < kSubmitters; ++t)
      threads.emplace_back([&] {
        try {
          for (int i = next++; i < count; i = next++) work(i);
        } catch (...) {
          if (!has_failed.test_and_set()) error = std::current_exception();
          next = count;
        }
      });
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace saltus::benchmark
