#include "calligraphy_brush/common/thread_pool.h"

#include <chrono>

namespace calligraphy_brush {

ThreadPool::ThreadPool(int threads) {
  try {
    for (int thread = 1; thread < threads; ++thread)
      workers_.emplace_back([this, thread] { work(thread); });
  } catch (...) {
    finish();
    throw;
  }
}

ThreadPool::~ThreadPool() {
  finish();
}

void ThreadPool::finish() {
  stop_ = true;
  start();
  for (auto& worker : workers_) worker.join();
}

void ThreadPool::start() {
  // Under the lock, so that no worker can be between its last look at round_ and its sleep.
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++round_;
  }
  wake_.notify_all();
}

void ThreadPool::run(int count, const std::function<void(int, int)>& task) {
  if (workers_.empty() || count <= 1) {
    for (int index = 0; index < count; ++index) task(index, 0);
    return;
  }
  count_ = count;
  task_ = &task;
  next_ = 0;
  busy_ = static_cast<int>(workers_.size());
  start();
  takeIndices(0);
  while (busy_.load(std::memory_order_acquire) > 0) std::this_thread::yield();
}

void ThreadPool::takeIndices(int thread) {
  for (int index = next_++; index < count_; index = next_++) (*task_)(index, thread);
}

void ThreadPool::work(int thread) {
  unsigned seen = 0;
  for (;;) {
    // Yielding keeps the hand-over short; after a quiet millisecond the processor is for others.
    const auto quiet_since = std::chrono::steady_clock::now();
    while (round_.load(std::memory_order_acquire) == seen) {
      if (std::chrono::steady_clock::now() - quiet_since < std::chrono::milliseconds(1)) {
        std::this_thread::yield();
        continue;
      }
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [&] { return round_.load(std::memory_order_acquire) != seen; });
    }
    ++seen;
    if (stop_) return;
    takeIndices(thread);
    busy_.fetch_sub(1, std::memory_order_release);
  }
}

}  // namespace calligraphy_brush
