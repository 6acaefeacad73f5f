#include "client/cli/command_line.h"
#include "client/cli/output_errors.h"

int main(int argument_count, char** arguments) {
  saltus::cli::let_writes_fail();
  return saltus::cli::run_command_line(argument_count, arguments);
}
