#include "server/observe/json_line.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

TEST(JsonLine, KeepsOrderAndEscapes) {
  EXPECT_EQ(JsonLine().str(), "{}");
  EXPECT_EQ(JsonLine()
                .add("b", "quote \" backslash \\ newline \n tab \t")
                .add("a", std::int64_t{-7})
                .add("list", std::vector<std::string>{"x", "y\""})
                .add("none", std::vector<std::string>{})
                .str(),
            R"({"b":"quote \" backslash \\ newline \u000a tab \u0009","a":-7,"list":["x","y\""],"none":[]})");
}

TEST(JsonLine, WhatIsNoUtf8DoesNotGetThrough) {
  EXPECT_EQ(json_string("M\xc3\xbcller \xe2\x82\xac \xf0\x9f\x98\x80"),
            "\"M\xc3\xbcller \xe2\x82\xac \xf0\x9f\x98\x80\"");
  EXPECT_EQ(json_string("\xff"), "\"?\"");
  EXPECT_EQ(json_string("a\xc3"), "\"a?\"");
  EXPECT_EQ(json_string("\xc0\xaf"), "\"??\"");            // overlong
  EXPECT_EQ(json_string("\xed\xa0\x80"), "\"???\"");       // a surrogate
  EXPECT_EQ(json_string("\xf4\x90\x80\x80"), "\"????\"");  // beyond Unicode
  EXPECT_EQ(json_string(std::string("\0\x7f", 2)), "\"\\u0000\\u007f\"");
}

}  // namespace
}  // namespace saltus::server
