#pragma once

#include "server/rpc/stall_watch.h"
#include "server/rpc/status_map.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include <grpcpp/support/server_callback.h>

#include <exception>

namespace saltus::server {

/// A stream of answers that are made on the task pool, one after the other, with one write outstanding. At any moment
/// either a write or a task is under way, or the stream is finished; whoever has the turn may touch the members.
/// Deletes itself when gRPC is done with it.
template <class Response>
class PooledWriter : public grpc::ServerWriteReactor<Response> {
 public:
  void OnWriteDone(bool is_ok) final {
    stall_.moved();
    if (!is_ok) return this->Finish(grpc::Status::CANCELLED);
    post();
  }

  void OnDone() final { delete this; }

 protected:
  PooledWriter(TaskPool& pool, StallWatch& stalls, grpc::CallbackServerContext& context)
      : pool_(pool), context_(context), stall_(stalls, context) {}

  /// One step, on the pool; ends with one of post(), write() or finish(). What it throws finishes the stream.
  virtual void step() = 0;
  /// Gives back what the stream holds of others: the client must find it free when it has the answer.
  virtual void release() = 0;

  /// Takes a place at `gate` under `name` and prepares; when that throws, the stream ends with it, else the first step
  /// follows.
  template <class Prepare>
  void begin(StreamGate& gate, const std::string& name, Prepare&& prepare) {
    try {
      prepare();
      pass_ = gate.enter(name);
    } catch (...) {
      return finish(std::current_exception());
    }
    post();
  }

  void post() {
    pool_.post([this] {
      try {
        if (context_.IsCancelled()) return this->Finish(grpc::Status::CANCELLED);
        step();
      } catch (...) {
        finish(std::current_exception());
      }
    });
  }

  void write() {
    stall_.waits();
    this->StartWrite(&response_);
  }

  void finish(std::exception_ptr error) {
    release();
    pass_.reset();
    this->Finish(status_of(error, context_));
  }

  Response response_;

 private:
  TaskPool& pool_;
  grpc::CallbackServerContext& context_;
  StallWatch::Stream stall_;
  StreamGate::Pass pass_;
};

}  // namespace saltus::server
