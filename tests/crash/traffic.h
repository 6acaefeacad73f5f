#pragma once

#include "tests/crash/model.h"

#include <functional>
#include <random>

namespace saltus::crash {

/// One client that does what clients do, at random.
class Traffic {
 public:
  /// `real` is a specification for the real worker, of blobs that the daemon holds.
  Traffic(const std::string& owner, unsigned seed, v1::RegistrationSpec real);

  /// Does so many things, or fewer when the daemon goes. Throws Violation.
  void run(const std::string& address, int actions);

  Model model;

 private:
  void act(Connection& daemon);
  void upload(Connection& daemon);
  void create(Connection& daemon);
  void create_again(Connection& daemon);
  void get(Connection& daemon);
  void watch(Connection& daemon);
  void cancel(Connection& daemon);
  void remove(Connection& daemon);
  int random_below(int count) { return std::uniform_int_distribution<int>(0, count - 1)(generator_); }
  KnownJob* random_job();

  std::mt19937 generator_;
  const v1::RegistrationSpec real_;
};

}  // namespace saltus::crash
