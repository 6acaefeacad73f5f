#pragma once

namespace saltus::cli {

/// Runs one command as `saltus ARGUMENTS...` would and returns its exit code (see command.h). Errors are said in one
/// sentence on standard error; that standard output cannot be written is one of them.
int run_command_line(int argument_count, const char* const* arguments);

}  // namespace saltus::cli
