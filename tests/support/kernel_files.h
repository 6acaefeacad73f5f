#pragma once

#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

namespace saltus::testing_support {

/// A root with the files that the kernel makes of control groups and memory, as in its documentation.
class KernelFiles : public ::testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) {
    std::filesystem::create_directories((folder_ / name).parent_path());
    folder_.write(name, text);
  }

  TemporaryFolder folder_;
};

}  // namespace saltus::testing_support
