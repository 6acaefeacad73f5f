#pragma once

#include <stdexcept>
#include <string>

namespace saltus {

/// The caller gave something that cannot be used. Thrown before any work is done.
/// The message is one sentence that names the field, the value and the way out.
class InvalidInput : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// A file could not be read or written. The message names the file and the reason.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The arithmetic broke in a way that no shorter step can mend.
class NumericalFailure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace saltus
