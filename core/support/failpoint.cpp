#include "core/support/failpoint.h"

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <new>
#include <string>
#include <thread>

namespace saltus {
namespace {

/// Without a limit of the process, taking memory must not take the whole machine's.
constexpr std::size_t most_memory = std::size_t{1} << 30;
constexpr std::size_t piece = 1 << 16;

struct Chosen {
  std::string name;
  std::string action = "kill";
  const char* armed_file = std::getenv("SALTUS_FAILPOINT_ARMED");
  const char* once_file = std::getenv("SALTUS_FAILPOINT_ONCE");
  const char* record_file = std::getenv("SALTUS_FAILPOINT_RECORD");
  std::atomic<int> passes_left = 1;

  Chosen() {
    const char* text = std::getenv("SALTUS_FAILPOINT");
    if (!text) return;
    name = text;
    if (const auto equals = name.find('='); equals != std::string::npos) {
      action = name.substr(equals + 1);
      name.resize(equals);
    }
    if (const auto colon = name.find(':'); colon != std::string::npos) {
      passes_left = std::atoi(name.c_str() + colon + 1);
      name.resize(colon);
    }
  }
};

/// A write that no compiler may leave out, and with it the allocation.
void touch(void* memory) { *static_cast<volatile char*>(memory) = 1; }

void take_memory_by_new() {
#pragma omp parallel num_threads(2)
  for (std::size_t taken = 0; taken < most_memory; taken += piece) touch(::operator new(piece));
}

void take_memory_by_malloc() {
  for (std::size_t taken = 0; taken < most_memory; taken += piece) {
    void* const memory = std::malloc(piece);
    if (!memory) std::abort();
    touch(memory);
  }
}

/// A short line goes to a file that is appended to in one write: lines of several processes do not mix.
void record(const char* file, const std::string& line) {
  std::ofstream out(file, std::ios::app);
  out << line + '\n' << std::flush;
  if (!out) std::abort();
}

void act(const std::string& action) {
  if (action == "segv") std::raise(SIGSEGV);
  if (action == "exit") std::_Exit(0);
  if (action == "stop") std::raise(SIGSTOP);
  if (action == "new") take_memory_by_new();
  if (action == "malloc") take_memory_by_malloc();
  while (action == "hang") std::this_thread::sleep_for(std::chrono::hours(1));
  for (std::atomic<int> turns = 0; action == "spin";) ++turns;
}

}  // namespace

void reach_failpoint(const char* name) {
  static Chosen chosen;
  if (chosen.name != name) return;
  if (chosen.armed_file && !std::ifstream(chosen.armed_file)) return;
  if (--chosen.passes_left != 0) return;
  if (chosen.once_file && std::remove(chosen.once_file) != 0) return;
  if (chosen.record_file) record(chosen.record_file, name);
  if (chosen.action == "kill") std::raise(SIGKILL);
  std::cerr << "failpoint " << name << ": " << chosen.action << std::endl;
  act(chosen.action);
}

}  // namespace saltus
