#pragma once

/// Places at which a test can end or disturb a process by force, to see what is left. Only programs built for tests
/// have them (`saltusd-failpoints` and `saltus-worker-failpoints`, see tests/crash); elsewhere SALTUS_FAILPOINT is
/// nothing.
///
/// The environment's SALTUS_FAILPOINT is "<name>[:<count>][=<action>]": when the process comes to the place of this
/// name for the count-th time, it
///
///     kill    kills itself, which is what happens when no action is given
///     segv    dies as from a bad pointer
///     exit    ends with code 0 as if all were well
///     hang    does not go on in this thread; the others do
///     spin    the same, and takes processor time for ever
///     stop    stops as a whole until somebody sends SIGCONT
///     new     takes memory with `new` in two threads of a parallel loop until there is none
///     malloc  takes memory with malloc until there is none, and aborts as C libraries then do
///
/// What it is going to do stands on standard error first, but for kill. When SALTUS_FAILPOINT_ARMED names a file, only
/// what happens while that file is there counts; when SALTUS_FAILPOINT_ONCE does, whichever process acts first removes
/// it, and no other acts. The file that SALTUS_FAILPOINT_RECORD names gets a line from each process that acts.
#ifdef SALTUS_FAILPOINTS
namespace saltus {
void reach_failpoint(const char* name);
}
#define SALTUS_FAILPOINT(name) ::saltus::reach_failpoint(name)
#else
#define SALTUS_FAILPOINT(name) static_cast<void>(0)
#endif
