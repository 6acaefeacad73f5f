#pragma once

#include <chrono>
#include <optional>
#include <string>

namespace saltus::server {

/// What started this process and wants to hear how it goes: systemd, or what speaks its protocol (sd_notify(3)):
/// datagrams to the socket that the environment names. Says nothing when there is none. Thread-safe.
class ServiceManager {
 public:
  /// Takes NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID out of the environment, so that no worker speaks for the
  /// daemon; to be called before any thread is made. Throws InvalidInput when what they say cannot be meant.
  static ServiceManager from_environment();

  ServiceManager(std::string socket, std::optional<std::chrono::microseconds> watchdog)
      : socket_(std::move(socket)), watchdog_(watchdog) {}

  /// The process is ended when alive() is not called for so long; nothing: nobody waits for it.
  const std::optional<std::chrono::microseconds>& watchdog() const { return watchdog_; }

  /// These throw std::runtime_error when the other side does not take the message; they never wait for it.
  void ready(const std::string& status) const;
  void alive() const;
  void stopping() const;

 private:
  void send(const std::string& message) const;

  const std::string socket_;
  const std::optional<std::chrono::microseconds> watchdog_;
};

}  // namespace saltus::server
