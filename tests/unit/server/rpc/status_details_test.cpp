// The oracle reads the bytes by a description of google.rpc's messages that is made here, field by field, and by
// protobuf's own reader.
#include "server/rpc/status_details.h"

#include <gmock/gmock.h>
#include <google/protobuf/any.pb.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/duration.pb.h>
#include <google/protobuf/dynamic_message.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <memory>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;

constexpr const char* kDescription = R"(
  name: "oracle.proto" package: "google.rpc" syntax: "proto3"
  dependency: "google/protobuf/any.proto" dependency: "google/protobuf/duration.proto"
  message_type { name: "Status"
    field { name: "code" number: 1 type: TYPE_INT32 label: LABEL_OPTIONAL }
    field { name: "message" number: 2 type: TYPE_STRING label: LABEL_OPTIONAL }
    field { name: "details" number: 3 type: TYPE_MESSAGE type_name: ".google.protobuf.Any" label: LABEL_REPEATED } }
  message_type { name: "ErrorInfo"
    field { name: "reason" number: 1 type: TYPE_STRING label: LABEL_OPTIONAL }
    field { name: "domain" number: 2 type: TYPE_STRING label: LABEL_OPTIONAL } }
  message_type { name: "RetryInfo"
    field { name: "retry_delay" number: 1 type: TYPE_MESSAGE type_name: ".google.protobuf.Duration"
            label: LABEL_OPTIONAL } }
  message_type { name: "BadRequest"
    field { name: "field_violations" number: 1 type: TYPE_MESSAGE type_name: "Violation" label: LABEL_REPEATED }
    nested_type { name: "Violation"
      field { name: "field" number: 1 type: TYPE_STRING label: LABEL_OPTIONAL }
      field { name: "description" number: 2 type: TYPE_STRING label: LABEL_OPTIONAL } } }
  message_type { name: "QuotaFailure"
    field { name: "violations" number: 1 type: TYPE_MESSAGE type_name: "Violation" label: LABEL_REPEATED }
    nested_type { name: "Violation"
      field { name: "subject" number: 1 type: TYPE_STRING label: LABEL_OPTIONAL }
      field { name: "description" number: 2 type: TYPE_STRING label: LABEL_OPTIONAL } } }
  message_type { name: "PreconditionFailure"
    field { name: "violations" number: 1 type: TYPE_MESSAGE type_name: "Violation" label: LABEL_REPEATED }
    nested_type { name: "Violation"
      field { name: "type" number: 1 type: TYPE_STRING label: LABEL_OPTIONAL }
      field { name: "subject" number: 2 type: TYPE_STRING label: LABEL_OPTIONAL }
      field { name: "description" number: 3 type: TYPE_STRING label: LABEL_OPTIONAL } } })";

class StatusDetailsTest : public ::testing::Test {
 protected:
  StatusDetailsTest() : pool(google::protobuf::DescriptorPool::generated_pool()), factory(&pool) {
    // Known to the generated pool from here on.
    google::protobuf::Any::descriptor();
    google::protobuf::Duration::descriptor();
    google::protobuf::FileDescriptorProto file;
    EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(kDescription, &file));
    EXPECT_NE(pool.BuildFile(file), nullptr);
  }
  /// As one line of text; unknown fields would show.
  std::string read(const std::string& type, const std::string& bytes) {
    const auto* descriptor = pool.FindMessageTypeByName("google.rpc." + type);
    if (!descriptor) return "no " + type;
    std::unique_ptr<google::protobuf::Message> message(factory.GetPrototype(descriptor)->New());
    return message->ParseFromString(bytes) ? message->ShortDebugString() : "damaged";
  }
  /// The details one by one, "Type: text".
  std::vector<std::string> details(const StatusDetails& of) {
    const auto* descriptor = pool.FindMessageTypeByName("google.rpc.Status");
    std::unique_ptr<google::protobuf::Message> status(factory.GetPrototype(descriptor)->New());
    EXPECT_TRUE(status->ParseFromString(encode(of)));
    const auto* reflection = status->GetReflection();
    EXPECT_EQ(reflection->GetInt32(*status, descriptor->FindFieldByName("code")), of.code);
    EXPECT_EQ(reflection->GetString(*status, descriptor->FindFieldByName("message")), of.message);
    std::vector<std::string> found;
    const auto* field = descriptor->FindFieldByName("details");
    for (int i = 0; i < reflection->FieldSize(*status, field); ++i) {
      google::protobuf::Any any;
      EXPECT_TRUE(any.ParseFromString(reflection->GetRepeatedMessage(*status, field, i).SerializeAsString()));
      const std::string prefix = "type.googleapis.com/google.rpc.";
      EXPECT_EQ(any.type_url().substr(0, prefix.size()), prefix);
      const std::string type = any.type_url().substr(prefix.size());
      found.push_back(type + ": " + read(type, any.value()));
    }
    return found;
  }

  google::protobuf::DescriptorPool pool;
  google::protobuf::DynamicMessageFactory factory;
};

TEST_F(StatusDetailsTest, EveryErrorHasItsReason) {
  StatusDetails error;
  error.code = 5;
  error.message = "there is no such job";
  error.reason = "JOB_NOT_FOUND";
  EXPECT_THAT(details(error), ElementsAre("ErrorInfo: reason: \"JOB_NOT_FOUND\" domain: \"saltus\""));
}

TEST_F(StatusDetailsTest, OtherDetailsAreThereWhenTheySaySomething) {
  StatusDetails error;
  error.code = 9;
  error.reason = "INPUT_MISSING";
  error.retry_after = std::chrono::milliseconds(1500);
  error.invalid_field.emplace("spec.fixed", "it is not there");
  error.missing = {"sha256:a", "sha256:b"};
  EXPECT_THAT(
      details(error),
      ElementsAre(
          "ErrorInfo: reason: \"INPUT_MISSING\" domain: \"saltus\"",
          "RetryInfo: retry_delay { seconds: 1 nanos: 500000000 }",
          "BadRequest: field_violations { field: \"spec.fixed\" description: \"it is not there\" }",
          "PreconditionFailure: violations { type: \"MISSING\" subject: \"sha256:a\" description: \"the blob is "
          "not on the server\" } violations { type: \"MISSING\" subject: \"sha256:b\" description: \"the blob "
          "is not on the server\" }"));
}

TEST_F(StatusDetailsTest, AFullMeasureIsAQuotaFailure) {
  StatusDetails error;
  error.code = 8;
  error.reason = "QUOTA";
  error.message = "too much";
  error.exhausted = "submitter";
  EXPECT_THAT(details(error),
              ElementsAre("ErrorInfo: reason: \"QUOTA\" domain: \"saltus\"",
                          "QuotaFailure: violations { subject: \"submitter\" description: \"too much\" }"));
}

}  // namespace
}  // namespace saltus::server
