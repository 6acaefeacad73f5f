// Clients that open transfers and then do nothing.
#include "server/rpc/limits.h"
#include "tests/integration/server/daemon_test.h"

#include <future>

namespace saltus::server {
namespace {

class StalledTransfer : public testing_support::DaemonTest {
 protected:
  void SetUp() override {
    DaemonParts parts;
    parts.clock = clock;
    start(std::move(parts));
    // A window that grows with what has arrived holds all of a blob now and then, and nothing stands still.
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
    channel = grpc::CreateCustomChannel(daemon->address(), grpc::InsecureChannelCredentials(), arguments);
    blobs = v1::BlobService::NewStub(channel);
  }
  struct Download {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::ReadBlobResponse>> reader;
  };
  std::unique_ptr<Download> begin_download(const std::string& digest) {
    auto download = std::make_unique<Download>();
    v1::ReadBlobRequest request;
    request.set_digest(digest);
    download->reader = blobs->ReadBlob(&download->context, request);
    return download;
  }
  /// Takes all places at once, if it can, and gives them back.
  bool all_places_are_free(const std::string& digest) {
    std::vector<std::unique_ptr<Download>> taken;
    bool is_admitted = true;
    for (int i = 0; is_admitted && i < limits::kDownloadStreams; ++i) {
      taken.push_back(begin_download(digest));
      v1::ReadBlobResponse first;
      is_admitted = taken.back()->reader->Read(&first);
    }
    for (auto& download : taken) {
      download->context.TryCancel();
      for (v1::ReadBlobResponse rest; download->reader->Read(&rest);) {
      }
      download->reader->Finish();
    }
    return is_admitted;
  }
  /// Each stream stands still as soon as its window is full, whenever that is; time passes until it has ended.
  template <class Stream>
  grpc::StatusCode finish_as_time_passes(Stream& stream) {
    auto status = std::async(std::launch::async, [&] { return stream.Finish(); });
    while (status.wait_for(std::chrono::milliseconds(1)) != std::future_status::ready)
      clock->advance(limits::kStalledStream);
    return status.get().error_code();
  }
  std::shared_ptr<testing_support::FakeClock> clock = std::make_shared<testing_support::FakeClock>();
};

TEST_F(StalledTransfer, ReadersThatNeverReadLoseTheirPlaces) {
  const std::string digest = uploaded(std::string(20 << 20, 'x'));
  std::vector<std::unique_ptr<Download>> idle;
  for (int i = 0; i < limits::kDownloadStreams; ++i) {
    idle.push_back(begin_download(digest));
    v1::ReadBlobResponse first;
    ASSERT_TRUE(idle.back()->reader->Read(&first));  // has its place
  }
  {
    const auto refused = begin_download(digest);
    EXPECT_EQ(refused->reader->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(testing_support::reason_of(refused->context), "TOO_MANY_STREAMS");
    EXPECT_NE(testing_support::trailer_of(refused->context, "saltus-retry-after-ms"), "");
  }
  // Each of them stands still as soon as its window is full; time passes until all places are free.
  while (!all_places_are_free(digest)) clock->advance(limits::kStalledStream);
  for (auto& download : idle) {
    for (v1::ReadBlobResponse rest; download->reader->Read(&rest);) {
    }
    EXPECT_EQ(download->reader->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
}

TEST_F(StalledTransfer, AWriterThatFallsSilentLosesItsPlaceAndNotItsBytes) {
  const std::string content(3000000, 'x');
  grpc::ClientContext context;
  v1::WriteBlobResponse response;
  const auto writer = blobs->WriteBlob(&context, &response);
  v1::WriteBlobRequest request = announcement(content);
  request.set_data(content.substr(0, 1000000));
  ASSERT_TRUE(writer->Write(request));
  EXPECT_EQ(finish_as_time_passes(*writer), grpc::StatusCode::CANCELLED);
  // The stream's end reaches the client before the daemon has put the bytes away.
  while (write_status(content).committed_size() != 1000000) {
  }
  EXPECT_TRUE(upload_part(content, 1000000, content.size()).ok());
}

TEST_F(StalledTransfer, AReaderThatGoesOnIsNotCutOff) {
  const std::string digest = uploaded(std::string(20 << 20, 'x'));
  const auto download = begin_download(digest);
  v1::ReadBlobResponse response;
  std::size_t bytes = 0;
  while (download->reader->Read(&response)) {
    bytes += response.data().size();
    clock->advance(std::chrono::milliseconds(1500));
  }
  EXPECT_TRUE(download->reader->Finish().ok());
  EXPECT_EQ(bytes, std::size_t{20} << 20);
}

}  // namespace
}  // namespace saltus::server
