// Kills daemon and workers at named places and at random, under random traffic, and checks after each restart that
// everything that was acknowledged is kept. Exit code 0 when it is.
#include "tests/crash/harness.h"

#include <charconv>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <stdexcept>
#include <string>

namespace {

int number(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  if (!text) return otherwise;
  int value = 0;
  const char* const end = text + std::strlen(text);
  const auto [stopped, error] = std::from_chars(text, end, value);
  if (error != std::errc() || stopped != end || value < 1)
    throw std::invalid_argument(std::string(variable) + " is '" + text + "'; it must be a number of 1 or more");
  return value;
}

}  // namespace

int main(int, char** arguments) {
  using namespace saltus::crash;
  int cycles = 0, seed = 0;
  std::optional<Harness> harness;
  try {
    cycles = number("SALTUS_CRASH_CYCLES", 100);
    seed = number("SALTUS_CRASH_SEED", 1);
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
