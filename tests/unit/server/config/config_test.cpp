#include "server/config/config.h"

#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>
#include <sstream>

namespace saltus::server {
namespace {

using testing::HasSubstr;

ParsedConfig parse(std::vector<std::string> words) {
  words.insert(words.begin(), "saltusd");
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  return parse_config(static_cast<int>(arguments.size()), arguments.data());
}

/// What the program of the test has beside it is no worker.
std::vector<std::string> with_worker(std::vector<std::string> words) {
  words.insert(words.end(), {"--worker", "/bin/true"});
  return words;
}

std::string printed(std::vector<std::string> words) {
  words.push_back("--print-config");
  const ParsedConfig parsed = parse(words);
  EXPECT_TRUE(parsed.has_ended);
  EXPECT_EQ(parsed.exit_code, 0);
  return parsed.config_text;
}

/// With the defaults said instead of shown.
std::string uncommented(const std::string& text) {
  std::istringstream in(text);
  std::string said, line;
  while (std::getline(in, line)) {
    const bool is_default = line.size() > 1 && line[0] == '#' && line[1] != ' ' && line.back() != '=';
    said += (is_default ? line.substr(1) : line) + "\n";
  }
  return said;
}

class ConfigText : public testing::Test {
 protected:
  std::string file(const std::string& text) { return folder.write("saltusd.conf", text).string(); }
  std::string refusal(const std::string& text) {
    try {
      parse({"--config", file(text)});
    } catch (const InvalidInput& error) {
      return error.what();
    }
    return "";
  }
  /// Every option, with a value that is not its default.
  std::vector<std::string> everything() {
    std::vector<std::string> words = {"--exit-on-stdin-close", "--slurm-option=--partition=long",
                                      "--slurm-option=--account=a b"};
    const std::pair<std::string, std::string> options[] = {{"--data", folder / "data"},
                                                           {"--listen", "unix:/run/x.sock"},
                                                           {"--listen", "0.0.0.0:50051"},
                                                           {"--tls-cert", "/a folder/c.pem"},
                                                           {"--tls-key", "/k"},
                                                           {"--tls-client-ca", "/a"},
                                                           {"--roles", "/r"},
                                                           {"--slots", "3"},
                                                           {"--threads-per-job", "2"},
                                                           {"--threads", "7"},
                                                           {"--memory-budget", "3.7"},
                                                           {"--worker", "/bin/true"},
                                                           {"--launcher", "slurm"},
                                                           {"--slurm-server", "login:50051"},
                                                           {"--slurm-tls-ca", "/n/a"},
                                                           {"--slurm-tls-cert", "/n/c"},
                                                           {"--slurm-tls-key", "/n/k"},
                                                           {"--slurm-worker", "/n/saltus-worker"},
                                                           {"--slurm-shared-data", "/n/data"},
                                                           {"--slurm-poll-seconds", "2.5"},
                                                           {"--slurm-patience-seconds", "7.5"},
                                                           {"--slurm-pilots", "9"},
                                                           {"--slurm-pilot-memory", "2.5"},
                                                           {"--slurm-pilot-idle-seconds", "7"},
                                                           {"--lease-seconds", "12.5"},
                                                           {"--checkpoint-seconds", "0"},
                                                           {"--keep-inputs-days", "1"},
                                                           {"--keep-results-days", "2"},
                                                           {"--keep-uploads-hours", "3"},
                                                           {"--disk-reserve", "10%"},
                                                           {"--queue-per-submitter", "17"},
                                                           {"--upload-quota", "4G"},
                                                           {"--retry-seconds", "1.5"},
                                                           {"--stall-seconds", "60"},
                                                           {"--log-level", "debug"},
                                                           {"--log-format", "json"},
                                                           {"--metrics", "127.0.0.1:9464"}};
    for (const auto& [option, value] : options) words.insert(words.end(), {option, value});
    return words;
  }
  testing_support::TemporaryFolder folder;
};

TEST_F(ConfigText, OfEverythingSaysTheSameAsTheCommandLine) {
  const std::string text = printed(everything());
  EXPECT_EQ(parse({"--config", file(text)}).config, parse(everything()).config);
  EXPECT_EQ(printed({"--config", file(text)}), text);
  EXPECT_FALSE(parse({"--config", file(text)}).config == parse(with_worker({"--data", folder / "data"})).config);
}

TEST_F(ConfigText, ShowsTheDefaultsThatHold) {
  const std::string text = printed(with_worker({"--data", folder / "data"}));
  const Config expected = parse(with_worker({"--data", folder / "data"})).config;
  EXPECT_EQ(parse({"--config", file(text)}).config, expected);
  EXPECT_EQ(parse({"--config", file(uncommented(text))}).config, expected);
  EXPECT_NE(uncommented(text), text);
}

TEST_F(ConfigText, NamesEveryOption) {
  testing::internal::CaptureStdout();
  parse({"--help"});
  const std::string help = testing::internal::GetCapturedStdout();
  const std::set<std::string> not_in_files = {"help", "version", "config", "print-config", "fsck"};
  const std::string text = "\n" + printed({});
  const std::regex option("\n  (?:-h,)?--([a-z-]+)");
  int options = 0;
  for (auto found = std::sregex_iterator(help.begin(), help.end(), option); found != std::sregex_iterator(); ++found) {
    const std::string name = (*found)[1];
    EXPECT_EQ(text.find("\n#" + name + " =") == std::string::npos, not_in_files.contains(name)) << name;
    ++options;
  }
  EXPECT_GT(options, 25) << help;
}

TEST_F(ConfigText, InSlurmNothingOfThisMachineIsCountedUnlessItIsSaid) {
  const Config config = parse({"--data", folder / "data", "--launcher", "slurm"}).config;
  EXPECT_EQ(config.slots, 100);
  EXPECT_EQ(config.threads, 0);
  EXPECT_EQ(config.memory_budget, 0);
  EXPECT_EQ(config.slurm.worker, config.worker);
  const Config told = parse({"--data", folder / "data", "--launcher", "slurm", "--slots", "7", "--threads", "99",
                             "--memory-budget", "2"})
                          .config;
  EXPECT_EQ(told.slots, 7);
  EXPECT_EQ(told.threads, 99);
  EXPECT_EQ(told.memory_budget, std::int64_t{2} << 30);
  EXPECT_EQ(parse({"--data", folder / "data", "--slots", "0"}).config.slots, 0);
}

TEST_F(ConfigText, ASlurmWhoseWorkersCouldNotComeIsRefused) {
  const auto refused = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"--data", folder / "data", "--launcher", "slurm"});
    try {
      parse(words);
    } catch (const InvalidInput& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::vector<std::string> tls = {"--tls-cert",      "/c", "--tls-key", "/k",
                                        "--tls-client-ca", "/a", "--roles",   "/r"};
  const auto with = [&](std::vector<std::string> words) {
    words.insert(words.end(), tls.begin(), tls.end());
    return words;
  };
  EXPECT_THAT(refused(with({"--listen", "0.0.0.0:50051"})), HasSubstr("add --slurm-server HOST:PORT"));
  EXPECT_THAT(refused(with({"--listen", "login:50051"})), HasSubstr("need --slurm-tls-ca"));
  EXPECT_THAT(refused({"--slurm-server", "login:50051"}), HasSubstr("need --slurm-tls-ca"));
  EXPECT_THAT(refused({"--slurm-server", "login:50051", "--slurm-tls-ca", "/a"}), HasSubstr("give all three"));
  EXPECT_THAT(refused({"--slurm-option=-p"}), HasSubstr("--slurm-option is -p"));
  EXPECT_EQ(refused({"--slurm-server", "127.0.0.1:50051"}), "");
}

TEST_F(ConfigText, GivesWayToTheCommandLine) {
  const std::string path = file("data = " + (folder / "data").string() + "\nslots = 3\nworker = /bin/true\n");
  const Config config = parse({"--slots", "5", "--config", path}).config;
  EXPECT_EQ(config.slots, 5);
  EXPECT_EQ(config.data, folder / "data");
}

TEST_F(ConfigText, RefusesWhatItDoesNotKnowAndNamesTheLine) {
  EXPECT_THAT(refusal("data = /x\n\nslot = 3\n"), AllOf(HasSubstr("line 3"), HasSubstr("'slot' is no option")));
  EXPECT_THAT(refusal("slots 3\n"), AllOf(HasSubstr("line 1"), HasSubstr("no 'name = value'")));
  EXPECT_THAT(refusal("roles =\n"), AllOf(HasSubstr("line 1"), HasSubstr("has no value")));
  EXPECT_THAT(refusal("slots = 1\nslots = 2\n"), AllOf(HasSubstr("line 2"), HasSubstr("second time")));
  EXPECT_THAT(refusal("exit-on-stdin-close = yes\n"), HasSubstr("must be true or false"));
  EXPECT_THAT(refusal("fsck = true\n"), HasSubstr("'fsck' is no option of this file"));
  EXPECT_THAT(refusal("slots = 1\n"), HasSubstr("--data is not given"));
}

TEST_F(ConfigText, RefusesAFileThatIsNotThere) {
  testing::internal::CaptureStderr();
  const ParsedConfig parsed = parse({"--config", folder / "absent"});
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("absent"));
  EXPECT_TRUE(parsed.has_ended);
  EXPECT_EQ(parsed.exit_code, 2);
}

TEST_F(ConfigText, RefusesAValueOutsideItsRange) {
  testing::internal::CaptureStderr();
  EXPECT_EQ(parse({"--config", file("data = /x\nslots = -1\n")}).exit_code, 2);
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("--slots"));
}

}  // namespace
}  // namespace saltus::server
