#pragma once

#include <mutex>

namespace saltus {

/// Held while ITK writes, so that files can be written by several threads: its NRRD errors, the table of what it has
/// one of and HDF5 are the whole program's and guarded by nobody.
inline std::mutex itk_lock;

}  // namespace saltus
