#include "tests/benchmark/service_load/client_calls.h"

#include <grpcpp/create_channel.h>
#include <openssl/evp.h>

#include <cstdio>
#include <stdexcept>

namespace saltus::benchmark {

std::string digest_of(const std::string& data) {
  unsigned char hash[EVP_MAX_MD_SIZE];
  unsigned size = 0;
  EVP_Digest(data.data(), data.size(), hash, &size, EVP_sha256(), nullptr);
  std::string text = "sha256:";
  char hex[3];
  for (unsigned i = 0; i < size; ++i) {
    std::snprintf(hex, sizeof hex, "%02x", hash[i]);
    text += hex;
  }
  return text;
}

std::shared_ptr<grpc::Channel> connect(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
}

void require(const grpc::Status& status, const char* what) {
  if (!status.ok()) throw std::runtime_error(std::string(what) + ": " + status.error_message());
}

grpc::Status upload(v1::BlobService::Stub& stub, const std::string& data) {
  constexpr std::size_t kChunk = 1 << 20;
  grpc::ClientContext context;
  v1::WriteBlobResponse response;
  const auto writer = stub.WriteBlob(&context, &response);
  v1::WriteBlobRequest request;
  request.set_digest(digest_of(data));
  request.set_size(static_cast<std::int64_t>(data.size()));
  bool is_open = writer->Write(request);
  request.Clear();
  for (std::size_t at = 0; is_open && at < data.size(); at += kChunk) {
    request.set_data(data.substr(at, kChunk));
    is_open = writer->Write(request);
  }
  writer->WritesDone();
  return writer->Finish();
}

}  // namespace saltus::benchmark
