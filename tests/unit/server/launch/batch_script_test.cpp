// What a shell makes of the script that sbatch gets.
#include "server/launch/batch_script.h"

#include "server/launch/worker_environment.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <stdexcept>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

class BatchScriptTest : public ::testing::Test {
 protected:
  /// The words that the worker gets, one a line, and its standard input.
  std::string words_seen(const BatchRequest& request) {
    return output_of(request, "#!/bin/sh\nfor word; do echo \"<$word>\"; done\ncat\n");
  }
  std::string output_of(const BatchRequest& request, const std::string& worker_script) {
    const auto worker = folder.write("a 'worker'; $(false)", worker_script);
    std::filesystem::permissions(worker, std::filesystem::perms::owner_all);
    settings.worker = worker.string();
    const Command command = submission(settings, request);
    return run_command({{"/bin/sh"}, command.input}, 60s).output;
  }

  testing_support::TemporaryFolder folder;
  BatchSettings settings;
};

TEST_F(BatchScriptTest, NoWordIsReadAsACommand) {
  const std::string evil = "a b'; touch " + (folder / "evil").string() + "; echo '$(touch evil)`touch evil`\\\n&|*";
  settings.server_address = evil;
  settings.tls = {evil, evil, evil};
  settings.shared_data = evil;
  BatchRequest request;
  request.worker_arguments = {evil, ""};
  request.input = "token; touch evil $(touch evil) 'x";
  const std::string quoted = "<" + evil + ">\n";
  EXPECT_EQ(words_seen(request), "<--server>\n" + quoted + "<--tls-ca>\n" + quoted + "<--tls-cert>\n" + quoted +
                                     "<--tls-key>\n" + quoted + "<--blobs>\n<" + evil + "/blobs/sha256>\n" + quoted +
                                     "<>\n" + request.input + "\n");
  EXPECT_FALSE(std::filesystem::exists(folder / "evil"));
  request.input = "END_OF_INPUT\ntouch evil";
  EXPECT_THROW(submission(settings, request), std::logic_error);
}

TEST_F(BatchScriptTest, TheWorkerHasItsVariables) {
  BatchRequest request;
  request.threads = 3;
  const std::string environment = output_of(request, "#!/bin/sh\nenv\n");
  for (const std::string& variable :
       {std::string("OMP_NUM_THREADS=3"), std::string("OMP_WAIT_POLICY=PASSIVE"), std::string("OMP_PROC_BIND=false"),
        std::string("GOMP_SPINCOUNT=") + kBriefWait, std::string("GLIBC_TUNABLES=") + kLargePages})
    EXPECT_THAT(environment, HasSubstr(variable + "\n"));
}

}  // namespace
}  // namespace saltus::server
