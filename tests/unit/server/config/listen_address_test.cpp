#include "server/config/listen_address.h"

#include "core/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

TEST(ListenAddress, ReadsWhatItWrites) {
  for (const char* text : {"unix:/run/saltus/socket", "127.0.0.1:0", "localhost:7000", "[::1]:65535"})
    EXPECT_EQ(parse_listen_address(text).to_text(), text);
}

TEST(ListenAddress, WithMutualTlsEveryPortIsProtected) {
  for (const char* text : {"0.0.0.0:7000", "[::]:7000", "registry.hospital.example:0", "127.0.0.1:7000"}) {
    const auto address = parse_listen_address(text, Transport::MutualTls);
    EXPECT_EQ(address.kind, ListenAddress::Kind::Protected);
    EXPECT_EQ(address.to_text(), text);
  }
  EXPECT_EQ(parse_listen_address("unix:/run/socket", Transport::MutualTls).kind, ListenAddress::Kind::UnixSocket);
  EXPECT_THROW(parse_listen_address("0.0.0.0:port", Transport::MutualTls), InvalidInput);
}

TEST(ListenAddress, RefusesEverythingElseAndSaysWhy) {
  const std::pair<std::string, std::string> cases[] = {{"0.0.0.0:7000", "mutual TLS"},
                                                       {"192.168.1.5:7000", "mutual TLS"},
                                                       {"[::]:7000", "mutual TLS"},
                                                       {"127.0.0.1", "unix:/path"},
                                                       {":7000", "unix:/path"},
                                                       {"", "unix:/path"},
                                                       {"127.0.0.1:x", "port"},
                                                       {"127.0.0.1:65536", "port"},
                                                       {"127.0.0.1:-1", "port"},
                                                       {"unix:", "begin with /"},
                                                       {"unix:here", "begin with /"},
                                                       {"127.0.0.2:7000", "mutual TLS"},
                                                       {"unix:/" + std::string(107, 'x'), "107 characters"}};
  for (const auto& [text, way_out] : cases) {
    SCOPED_TRACE(text);
    try {
      parse_listen_address(text);
      FAIL() << "was accepted";
    } catch (const InvalidInput& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr("--listen is " + text));
      EXPECT_THAT(error.what(), ::testing::HasSubstr(way_out));
    }
  }
}

}  // namespace
}  // namespace saltus::server
