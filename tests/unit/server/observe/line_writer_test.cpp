#include "server/observe/line_writer.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace saltus::server {
namespace {

/// A pipe; nobody reads it unless the test does.
class LineWriterTest : public ::testing::Test {
 protected:
  LineWriterTest() {
    EXPECT_EQ(pipe2(ends, O_CLOEXEC), 0);
    EXPECT_GT(fcntl(ends[1], F_SETPIPE_SZ, 4096), 0);
  }
  ~LineWriterTest() override { close(ends[0]); }

  static std::string lost_line(std::uint64_t lost) { return "lost " + std::to_string(lost) + "\n"; }
  void open(std::size_t waiting) {
    writer.emplace(ends[1], lost_line, LineWriter::Limits{waiting, std::chrono::milliseconds(60000)});
  }
  /// All that is written from now on until the writer's end.
  std::vector<std::string> read_to_the_end() {
    std::thread closing([this] {
      writer.reset();
      close(ends[1]);
    });
    std::string text;
    char bytes[4096];
    for (ssize_t count = 0; (count = read(ends[0], bytes, sizeof bytes)) > 0;)
      text.append(bytes, static_cast<std::size_t>(count));
    closing.join();
    std::vector<std::string> lines;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) lines.push_back(line);
    return lines;
  }

  int ends[2] = {-1, -1};
  std::optional<LineWriter> writer;
};

TEST_F(LineWriterTest, WritesEveryLineInOrder) {
  open(1000);
  for (int i = 0; i < 1000; ++i) writer->add(std::to_string(i) + "\n");
  const auto lines = read_to_the_end();
  ASSERT_EQ(lines.size(), 1000u);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(lines[static_cast<std::size_t>(i)], std::to_string(i));
}

// Were add() to wait for a reader, this would never end: the pipe takes 4096 bytes, and nobody reads before all is
// said.
TEST_F(LineWriterTest, NobodyWaitsForAReaderAndWhatIsLostIsCounted) {
  open(100);
  constexpr int said = 10000;
  for (int i = 0; i < said; ++i) writer->add("line " + std::to_string(i) + " " + std::string(80, '.') + "\n");
  const auto dropped = writer->dropped();
  int next = 0, lost = 0;
  for (const std::string& line : read_to_the_end()) {
    std::istringstream in(line);
    std::string word;
    int number = 0;
    in >> word >> number;
    if (word == "line") {
      EXPECT_EQ(number, next);
      ++next;
    } else {
      ASSERT_EQ(word, "lost");
      lost += number;
      next += number;
    }
  }
  EXPECT_EQ(next, said);
  EXPECT_GT(lost, said / 2);
  EXPECT_EQ(static_cast<std::uint64_t>(lost), dropped);
}

TEST_F(LineWriterTest, ItsEndDoesNotWaitForAReaderForEver) {
  writer.emplace(ends[1], lost_line, LineWriter::Limits{100, std::chrono::milliseconds(1)});
  for (int i = 0; i < 100; ++i) writer->add(std::string(100, '.') + "\n");
  writer.reset();
  // The descriptor has to outlive the thread, which is now let go.
  char bytes[4096];
  for (int count = 0; count < 10100;) count += static_cast<int>(read(ends[0], bytes, sizeof bytes));
  close(ends[1]);
}

}  // namespace
}  // namespace saltus::server
