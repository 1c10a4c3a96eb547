#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace calligraphy_brush {

/// A fixed team of threads that shares out the indices of a loop.
///
/// Made for loops of a few microseconds that come in quick succession: a worker that has nothing to
/// do looks for work for a short while before it lets go of its processor.
class ThreadPool {
 public:
  /// threads ≥ 1; the caller of run() is one of them.
  explicit ThreadPool(int threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int threadCount() const { return static_cast<int>(workers_.size()) + 1; }

  /// Calls task(index, thread) once for each index in [0, count), and returns when all are done.
  /// Which thread (0 .. threadCount() − 1) gets which index is open. The task must not throw.
  void run(int count, const std::function<void(int, int)>& task);

 private:
  void start();
  void finish();
  void work(int thread);
  void takeIndices(int thread);

  std::vector<std::thread> workers_;
  std::atomic<unsigned> round_{0};  // a new value starts the workers
  std::atomic<int> next_{0};
  std::atomic<int> busy_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::condition_variable wake_;  // of workers that have been idle for a while
  int count_ = 0;
  const std::function<void(int, int)>* task_ = nullptr;
};

}  // namespace calligraphy_brush
