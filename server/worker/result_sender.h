#pragma once

#include "client/lib/checksum.h"

#include "saltus/v1/registration.pb.h"

#include <cstddef>
#include <functional>
#include <stop_token>
#include <string>
#include <vector>

namespace saltus::worker {

/// Sends the result of this number; ends early, by an exception, when stop is requested.
using SendOne = std::function<client::FileDigest(std::size_t index, const std::stop_token& stop)>;

/// Sends results of these names, two at a time: while one waits for the daemon, the other is read and digested. The
/// artifacts are in the order of the names. When one cannot be sent, the other is stopped, and what is thrown is the
/// first reason; ClientError CANCELLED when stop is requested before all are sent. One at a time where there can be no
/// other thread.
std::vector<v1::Artifact> send_results(const std::vector<std::string>& names, const SendOne& send,
                                       const std::stop_token& stop);

}  // namespace saltus::worker
