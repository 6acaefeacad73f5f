#pragma once

#include "saltus/v1/registration.pb.h"

#include <string>

namespace saltus::crash {

/// What a job is to deliver: made of its inputs and options alone, so that both worker and client know it.
inline std::string fake_result(const v1::RegistrationSpec& spec, const std::string& name) {
  std::string line = name + " of " + spec.fixed().digest() + " and " + spec.moving().digest();
  for (const char* option : {"regularisation", "tolerance"}) {
    const auto found = spec.settings().find(option);
    if (found != spec.settings().end()) line += std::string(", ") + option + " " + found->second;
  }
  std::string content;
  for (int i = 0; i < 100; ++i) content += std::to_string(i) + ": " + line + "\n";
  return content;
}

constexpr const char* fake_artifacts[] = {"displacement.nrrd", "report.json"};

/// Jobs with this output format are for the fake worker; the real one does the others.
constexpr const char* fake_format = "nrrd";

}  // namespace saltus::crash
