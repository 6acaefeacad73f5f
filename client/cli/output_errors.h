#pragma once

namespace saltus::cli {

/// From now on a write that cannot be done is an error, which is told and after which everything is cleared up; it no
/// longer ends the process where it stands. That is so in a pipe that nobody reads any more (SIGPIPE), beyond the
/// largest file that is allowed (SIGXFSZ), and where standard output or error is closed: no other file gets its number.
/// Of the whole process, and of those that it starts. To be called before any file is opened.
void let_writes_fail();

/// Sends what waits in the buffers to standard output. False when not all has arrived that was ever written there: a
/// full disk, a pipe that nobody reads.
bool has_output_arrived();

}  // namespace saltus::cli
