#pragma once

#include "core/support/errors.h"

#include <string>
#include <utility>

namespace saltus::server {

/// A field of a request that cannot be used; `field` is its path, such as spec.fixed.digest.
class InvalidField : public InvalidInput {
 public:
  InvalidField(std::string field, const std::string& message) : InvalidInput(message), field_(std::move(field)) {}
  const std::string& field() const { return field_; }

 private:
  std::string field_;
};

}  // namespace saltus::server
