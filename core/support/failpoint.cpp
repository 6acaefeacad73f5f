#include "core/support/failpoint.h"

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <string>

namespace saltus {
namespace {

struct Chosen {
  std::string name;
  const char* armed_file = std::getenv("SALTUS_FAILPOINT_ARMED");
  std::atomic<int> passes_left = 1;

  Chosen() {
    const char* text = std::getenv("SALTUS_FAILPOINT");
    if (!text) return;
    name = text;
    const auto colon = name.find(':');
    if (colon == std::string::npos) return;
    passes_left = std::atoi(name.c_str() + colon + 1);
    name.resize(colon);
  }
};

}  // namespace

void reach_failpoint(const char* name) {
  static Chosen chosen;
  if (chosen.name != name) return;
  if (chosen.armed_file && !std::ifstream(chosen.armed_file)) return;
  if (--chosen.passes_left == 0) std::raise(SIGKILL);
}

}  // namespace saltus
