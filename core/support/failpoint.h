#pragma once

/// Places at which a test can end a process by force, to see what is left. Only programs built for tests have them
/// (`saltusd-failpoints` and `saltus-worker-failpoints`, see tests/crash); elsewhere SALTUS_FAILPOINT is nothing.
///
/// The environment's SALTUS_FAILPOINT is "<name>" or "<name>:<count>": the process kills itself when it comes to the
/// place of this name for the count-th time. When SALTUS_FAILPOINT_ARMED names a file, only what happens while that
/// file is there counts.
#ifdef SALTUS_FAILPOINTS
namespace saltus {
void reach_failpoint(const char* name);
}
#define SALTUS_FAILPOINT(name) ::saltus::reach_failpoint(name)
#else
#define SALTUS_FAILPOINT(name) static_cast<void>(0)
#endif
