// Bytes that are no message, or not one that anybody means, against every method that the daemon serves. The methods
// are those of the table of rights, which has to have every one, so that a new method is tried without being named
// here.
#include "server/rpc/method_rules.h"
#include "tests/integration/server/daemon_test.h"
#include "tests/integration/server/generic_call.h"

#include <random>

namespace saltus::server {
namespace {

/// Wire format that goes wrong in every way it has, and nothing at all.
std::vector<std::string> raw_messages() {
  std::vector<std::string> messages = {
      "",
      "\xff\xff\xff\xff\xff",
      std::string("\x0a\xff\xff\xff\xff\x07"
                  "abc",
                  9),  // a text of 2 GiB, of which 3 bytes are there
      std::string("\x0a\x03"
                  "ab",
                  4),                                                       // a text that is cut off
      std::string("\x0a\x02\xc3\x28", 4),                                   // a text that is no UTF-8
      std::string("\x08\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", 12),  // a number of more than ten bytes
      std::string("\x0b\x0b\x0b\x0b", 4),                                   // groups that do not end
      std::string("\x0c", 1),                                               // one that did not begin
      std::string("\x00\x01", 2),                                           // field 0
      std::string("\xf8\xff\xff\xff\x0f\x01", 6),                           // the largest field number
      std::string(1000, '\0'),
      std::string(100000, '\x0a'),
  };
  // Messages in messages, deeper than anybody needs.
  std::string nested;
  for (int i = 0; i < 300; ++i) {
    std::string length;
    for (std::size_t size = nested.size(); length.empty() || size > 0; size >>= 7)
      length += static_cast<char>((size & 0x7f) | (size > 0x7f ? 0x80 : 0));
    nested = "\x0a" + length + nested;
  }
  messages.push_back(nested);
  // The first fields of any type there is, with a value of each kind of wire.
  for (int field = 1; field < 6; ++field) {
    const char number = static_cast<char>(field << 3);
    messages.push_back(std::string(1, number) + std::string(9, '\xff') + "\x01");
    messages.push_back(std::string(1, static_cast<char>(number | 1)) + std::string(8, '\xff'));
    messages.push_back(std::string(1, static_cast<char>(number | 2)) + "\x7f" + std::string(127, 'x'));
    messages.push_back(std::string(1, static_cast<char>(number | 5)) + std::string(4, '\xff'));
  }
  std::mt19937 generator(11);
  for (int i = 0; i < 60; ++i) {
    std::string noise(std::uniform_int_distribution<std::size_t>(1, 400)(generator), '\0');
    for (char& c : noise) c = static_cast<char>(generator());
    messages.push_back(noise);
  }
  return messages;
}

class RawBytes : public testing_support::DaemonTest {
 protected:
  void SetUp() override { start(); }

  void expect_alive(const std::string& after) {
    grpc::ClientContext context;
    v1::ServerInfo answer;
    ASSERT_TRUE(info->GetServerInfo(&context, {}, &answer).ok()) << "after " << after;
  }
};

TEST_F(RawBytes, EveryMethodAnswersThemOrRefusesThem) {
  // What a fault of ours, or of the library behind it, would be answered with.
  const std::set<grpc::StatusCode> faults = {grpc::StatusCode::UNKNOWN, grpc::StatusCode::INTERNAL,
                                             grpc::StatusCode::DATA_LOSS, grpc::StatusCode::DEADLINE_EXCEEDED};
  std::map<std::string, std::set<grpc::StatusCode>> codes;
  for (const MethodRule& rule : method_rules()) {
    const std::string method(rule.method);
    for (const std::string& message : raw_messages()) {
      const auto answer = testing_support::call_by_name(channel, method, message, true);
      codes[method].insert(answer.status.error_code());
      // gRPC's own services have their own idea of codes.
      EXPECT_FALSE(method.starts_with("/saltus.") && faults.contains(answer.status.error_code()))
          << method << " answers " << message.size() << " raw bytes with " << answer.status.error_code() << ": "
          << answer.status.error_message();
    }
    expect_alive(method);
  }
  EXPECT_GE(codes.size(), 19u);
  // Something was refused everywhere, or nothing was looked at.
  for (const auto& [method, seen] : codes) EXPECT_NE(seen, std::set{grpc::StatusCode::OK}) << method;
}

}  // namespace
}  // namespace saltus::server
