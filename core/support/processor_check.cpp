// Part of each program, so that one that was built for newer processors says so instead of dying by an illegal
// instruction, wherever it was copied to. Compiled for every processor, unlike what comes after it.
#include <cstdio>
#include <cstdlib>

namespace {

void require(bool is_there, const char* feature) {
  if (is_there) return;
  std::fprintf(stderr,
               "This processor has no %s, which this build of saltus needs; build one for it with -DSALTUS_ARCH=x86-64 "
               "(deploy/package takes that too), or run it elsewhere.\n",
               feature);
  std::_Exit(1);
}

// The first of all constructors: those of the numerics may use such instructions already.
__attribute__((constructor(101))) void require_processor() {
  __builtin_cpu_init();
  require(__builtin_cpu_supports("avx2"), "AVX2");
  require(__builtin_cpu_supports("fma"), "FMA");
  require(__builtin_cpu_supports("bmi2"), "BMI2");
}

}  // namespace
