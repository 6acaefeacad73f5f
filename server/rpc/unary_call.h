#pragma once

#include "server/jobs/job_manager.h"
#include "server/rpc/status_map.h"
#include "server/rpc/task_pool.h"

#include <grpcpp/server_context.h>

#include <exception>
#include <functional>

namespace saltus::server {

/// Answers at once from the callback thread: `work` must not block.
template <class Work>
grpc::ServerUnaryReactor* answer_now(grpc::CallbackServerContext* context, Work work) {
  auto* reactor = context->DefaultReactor();
  std::exception_ptr error;
  try {
    work();
  } catch (...) {
    error = std::current_exception();
  }
  reactor->Finish(status_of(error, *context));
  return reactor;
}

/// Answers when `work` has returned; it runs on the pool and may block.
template <class Work>
grpc::ServerUnaryReactor* answer_from_pool(TaskPool& pool, grpc::CallbackServerContext* context, Work work) {
  auto* reactor = context->DefaultReactor();
  pool.post([context, reactor, work = std::move(work)] {
    std::exception_ptr error;
    try {
      work();
    } catch (...) {
      error = std::current_exception();
    }
    reactor->Finish(status_of(error, *context));
  });
  return reactor;
}

/// Answers when the reply that `work` was given is called; `fill` makes the response of its value. `work` runs on the
/// pool and may throw instead of replying.
template <class Value, class Work, class Fill>
grpc::ServerUnaryReactor* answer_by_reply(TaskPool& pool, grpc::CallbackServerContext* context, Work work, Fill fill) {
  auto* reactor = context->DefaultReactor();
  Reply<Value> reply = [context, reactor, fill = std::move(fill)](std::exception_ptr error, const Value& value) {
    if (!error) {
      try {
        fill(value);
      } catch (...) {
        error = std::current_exception();
      }
    }
    reactor->Finish(status_of(error, *context));
  };
  pool.post([context, reactor, work = std::move(work), reply = std::move(reply)] {
    try {
      work(reply);
    } catch (...) {
      reactor->Finish(status_of(std::current_exception(), *context));
    }
  });
  return reactor;
}

}  // namespace saltus::server
