// Kills daemon and workers at named places and at random, under random traffic, and checks after each restart that
// everything that was acknowledged is kept. Exit code 0 when it is.
#include "tests/crash/harness.h"

#include <cstdlib>
#include <iostream>

namespace {

int number(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  return text ? std::atoi(text) : otherwise;
}

}  // namespace

int main(int, char** arguments) {
  using namespace saltus::crash;
  const int cycles = number("SALTUS_CRASH_CYCLES", 100), seed = number("SALTUS_CRASH_SEED", 1);
  std::optional<Harness> harness;
  try {
    harness.emplace(std::filesystem::absolute(arguments[0]).parent_path(), static_cast<unsigned>(seed));
    harness->run(cycles);
    std::cout << cycles << " cycles with seed " << seed << ": nothing lost. ";
    harness->summarise(std::cout);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "seed " << seed << ", " << (harness ? harness->where() : "start") << ": " << error.what() << std::endl;
    if (harness) harness->summarise(std::cerr);
    return 1;
  }
}
