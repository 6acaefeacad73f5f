#pragma once

#include "tests/crash/model.h"

#include <functional>
#include <random>

namespace saltus::crash {

/// How a client goes on.
enum class Pace {
  Busy,     ///< with the next thing at once
  Patient,  ///< mostly it watches what becomes of its jobs
  Stop,
};

/// One client that does what clients do, at random.
class Traffic {
 public:
  /// `real` is a specification for the real worker, of blobs that the daemon holds.
  Traffic(const std::string& owner, unsigned seed, v1::RegistrationSpec real);

  /// Does one thing after another, as `pace` says after each, or until the daemon goes; has garbage collected now and
  /// then when it `collects`. Throws Violation.
  void run(const std::string& address, bool collects, const std::function<Pace()>& pace);

  /// What the daemon has removed as garbage when this client asked it to.
  v1::CollectGarbageResponse collected;

  /// Brings every upload that was cut to its end. Throws DaemonGone.
  void finish_uploads(Connection& daemon);

  Model model;

 private:
  void act(Connection& daemon);
  void upload(Connection& daemon);
  void download(Connection& daemon);
  /// Begins an upload and hangs up somewhere.
  void begin_upload(Connection& daemon);
  /// Goes on with one that was cut, to its end or to another cut.
  void continue_upload(Connection& daemon);
  void create(Connection& daemon);
  void collect_garbage(Connection& daemon);
  void create_batch(Connection& daemon);
  void create_again(Connection& daemon);
  void get(Connection& daemon);
  void watch(Connection& daemon);
  void cancel(Connection& daemon);
  void remove(Connection& daemon);
  int random_below(int count) { return std::uniform_int_distribution<int>(0, count - 1)(generator_); }
  KnownJob* random_job();
  std::string random_bytes();
  v1::RegistrationSpec random_spec();

  std::mt19937 generator_;
  const v1::RegistrationSpec real_;
};

}  // namespace saltus::crash
