#pragma once

#include "saltus/v1/admin.grpc.pb.h"
#include "saltus/v1/registration.grpc.pb.h"

#include <grpcpp/grpcpp.h>

#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace saltus::crash {

/// The daemon has broken a promise.
class Violation : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The daemon did not answer: whether it has done what was asked is not known.
class DaemonGone : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Calls without retries: every answer is either the daemon's or DaemonGone.
class Connection {
 public:
  explicit Connection(const std::string& address);

  /// Each returns "" for success, else the reason of the refusal. Throws DaemonGone.
  std::string create(const v1::CreateRegistrationJobRequest& request, v1::RegistrationJob& job);
  std::string get(const std::string& id, v1::RegistrationJob& job);
  std::string cancel(const std::string& id, v1::RegistrationJob& job);
  std::string remove(const std::string& id);
  /// Stops after `events` events, or a moment without one.
  std::string watch(const std::string& id, int events, const std::function<void(const v1::RegistrationJob&)>& seen);
  std::string watch_to_the_end(const std::string& id, const std::function<void(const v1::RegistrationJob&)>& seen);
  /// `jobs` in the order of the requests.
  std::string create_batch(const std::vector<v1::CreateRegistrationJobRequest>& requests,
                           std::vector<v1::RegistrationJob>& jobs);
  /// Its digest.
  std::string upload(const std::string& bytes);
  /// Sends what belongs between `begin` and `end`, and then hangs up, unless that is the end of the whole. Returns
  /// whether the upload is done.
  bool upload_piece(const std::string& bytes, const std::string& upload_id, std::size_t begin, std::size_t end);
  v1::QueryWriteStatusResponse upload_status(const std::string& bytes, const std::string& upload_id);
  std::string download(const std::string& digest);
  std::vector<std::string> missing(const std::vector<std::string>& digests);
  std::vector<v1::RegistrationJob> list_all();
  v1::CollectGarbageResponse collect_garbage();
  /// Reads every blob on the daemon's side. Throws Violation when one is damaged or missing. Nothing when another
  /// client's check is under way.
  std::optional<v1::FsckResponse> check_blobs();

 private:
  /// The bytes from the request's write_offset to `end`; hangs up when that is not the end of the whole.
  grpc::Status send(grpc::ClientContext& context, v1::WriteBlobRequest request, const std::string& bytes,
                    std::size_t end);

  std::unique_ptr<v1::RegistrationService::Stub> jobs_;
  std::unique_ptr<v1::BlobService::Stub> blobs_;
  std::unique_ptr<v1::AdminService::Stub> admin_;
};

std::string digest_of(const std::string& bytes);

}  // namespace saltus::crash
