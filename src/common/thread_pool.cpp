#include "calligraphy_brush/common/thread_pool.h"

#include <chrono>

namespace calligraphy_brush {

ThreadPool::ThreadPool(int threads) {
  for (int thread = 1; thread < threads; ++thread) workers_.emplace_back([this, thread] { work(thread); });
}

ThreadPool::~ThreadPool() {
  stop_ = true;
  ++round_;
  for (auto& worker : workers_) worker.join();
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
  ++round_;
  takeIndices(0);
  while (busy_.load(std::memory_order_acquire) > 0) std::this_thread::yield();
}

void ThreadPool::takeIndices(int thread) {
  for (int index = next_++; index < count_; index = next_++) (*task_)(index, thread);
}

void ThreadPool::work(int thread) {
  unsigned seen = 0;
  for (;;) {
    // Yielding keeps the hand-over short; after a quiet millisecond, sleeping keeps the machine cool.
    auto quiet_since = std::chrono::steady_clock::now();
    for (int looks = 0; round_.load(std::memory_order_acquire) == seen; ++looks) {
      if (looks % 64 != 63) continue;
      if (std::chrono::steady_clock::now() - quiet_since < std::chrono::milliseconds(1))
        std::this_thread::yield();
      else
        std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    ++seen;
    if (stop_) return;
    takeIndices(thread);
    busy_.fetch_sub(1, std::memory_order_release);
  }
}

}  // namespace calligraphy_brush
