#include "server/rpc/status_details.h"

#include <google/protobuf/any.pb.h>
#include <google/protobuf/duration.pb.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>

#include <functional>
#include <string_view>

namespace saltus::server {
namespace {

using google::protobuf::internal::WireFormatLite;

/// Writes the fields of one message.
class Fields {
 public:
  Fields& text(int number, const std::string& value) {
    write([&](auto& out) { WireFormatLite::WriteBytes(number, value, &out); });
    return *this;
  }
  Fields& number(int number, int value) {
    write([&](auto& out) { WireFormatLite::WriteInt32(number, value, &out); });
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  void write(const std::function<void(google::protobuf::io::CodedOutputStream&)>& field) {
    google::protobuf::io::StringOutputStream stream(&bytes_);
    google::protobuf::io::CodedOutputStream out(&stream);
    field(out);
  }
  std::string bytes_;
};

/// One of Status.details.
std::string detail(std::string_view type, const std::string& bytes) {
  google::protobuf::Any any;
  any.set_type_url("type.googleapis.com/google.rpc." + std::string(type));
  any.set_value(bytes);
  return any.SerializeAsString();
}

std::string duration(std::chrono::milliseconds time) {
  google::protobuf::Duration message;
  message.set_seconds(time.count() / 1000);
  message.set_nanos(static_cast<int>(time.count() % 1000) * 1000000);
  return message.SerializeAsString();
}

}  // namespace

std::string encode(const StatusDetails& details) {
  Fields status;
  status.number(1, details.code).text(2, details.message);
  status.text(3, detail("ErrorInfo", Fields().text(1, details.reason).text(2, "saltus").bytes()));
  if (details.retry_after)
    status.text(3, detail("RetryInfo", Fields().text(1, duration(*details.retry_after)).bytes()));
  if (details.invalid_field) {
    const auto& [field, description] = *details.invalid_field;
    const std::string violation = Fields().text(1, field).text(2, description).bytes();
    status.text(3, detail("BadRequest", Fields().text(1, violation).bytes()));
  }
  if (details.exhausted) {
    const std::string violation = Fields().text(1, *details.exhausted).text(2, details.message).bytes();
    status.text(3, detail("QuotaFailure", Fields().text(1, violation).bytes()));
  }
  if (!details.missing.empty()) {
    Fields failure;
    for (const std::string& digest : details.missing)
      failure.text(1, Fields().text(1, "MISSING").text(2, digest).text(3, "the blob is not on the server").bytes());
    status.text(3, detail("PreconditionFailure", failure.bytes()));
  }
  return status.bytes();
}

}  // namespace saltus::server
