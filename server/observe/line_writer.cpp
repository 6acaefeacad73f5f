#include "server/observe/line_writer.h"

#include <unistd.h>

#include <cerrno>
#include <string_view>
#include <thread>
#include <utility>

namespace saltus::server {
namespace {

/// What cannot be written has nobody who could be told.
void write_all(int descriptor, std::string_view text) {
  while (!text.empty()) {
    const ssize_t count = ::write(descriptor, text.data(), text.size());
    if (count < 0 && errno != EINTR) return;
    if (count > 0) text.remove_prefix(static_cast<std::size_t>(count));
  }
}

}  // namespace

LineWriter::LineWriter(int descriptor, std::function<std::string(std::uint64_t)> lost_line, Limits limits)
    : state_(new State{descriptor, std::move(lost_line), limits, {}, {}, {}}) {
  std::thread([state = state_] { run(state); }).detach();
}

LineWriter::~LineWriter() {
  std::unique_lock lock(state_->mutex);
  state_->is_closing = true;
  state_->changed.notify_all();
  state_->changed.wait_for(lock, state_->limits.farewell,
                           [this] { return state_->waiting.empty() && !state_->is_writing; });
}

void LineWriter::add(std::string line) {
  std::lock_guard lock(state_->mutex);
  if (state_->waiting.size() >= state_->limits.waiting) {
    ++state_->lost;
    ++state_->dropped;
    return;
  }
  // Said in the order of things: what was lost came after what waits and before this line.
  if (const std::uint64_t lost = std::exchange(state_->lost, 0); lost > 0)
    state_->waiting.push_back(state_->lost_line(lost));
  state_->waiting.push_back(std::move(line));
  state_->changed.notify_all();
}

std::uint64_t LineWriter::dropped() const {
  const std::lock_guard lock(state_->mutex);
  return state_->dropped;
}

void LineWriter::run(const std::shared_ptr<State>& state) {
  std::unique_lock lock(state->mutex);
  while (true) {
    state->changed.wait(lock, [&] { return state->is_closing || !state->waiting.empty(); });
    if (state->waiting.empty() && state->lost == 0) return;
    std::string text;
    if (!state->waiting.empty()) {
      text = std::move(state->waiting.front());
      state->waiting.pop_front();
    }
    if (state->waiting.empty() && state->lost > 0) text += state->lost_line(std::exchange(state->lost, 0));
    state->is_writing = true;
    lock.unlock();
    write_all(state->descriptor, text);
    lock.lock();
    state->is_writing = false;
    state->changed.notify_all();
  }
}

}  // namespace saltus::server
