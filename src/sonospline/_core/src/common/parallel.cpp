#include "common/parallel.hpp"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace sono {
namespace {

constexpr int kMostThreads = 1024;

int default_thread_count() {
#ifdef __linux__
    cpu_set_t mask;
    if (sched_getaffinity(0, sizeof mask, &mask) == 0) return CPU_COUNT(&mask);
#endif
    const unsigned cores = std::thread::hardware_concurrency();
    return cores ? static_cast<int>(cores) : 1;
}

// One parallel_for in flight. Shared ownership: a worker that wakes late may still
// look at the counter after the caller has returned.
class Job {
  public:
    Job(std::size_t blocks, const std::function<void(std::size_t)> &body) : blocks_(blocks), body_(body) {}

    /// Takes blocks until none is left. After one has failed the others are only counted.
    void work() noexcept {
        for (std::size_t block; (block = next_.fetch_add(1)) < blocks_;) {
            try {
                if (!failed_.load(std::memory_order_relaxed)) body_(block);
            } catch (...) {
                if (!failed_.exchange(true)) failure_ = std::current_exception();
            }
            done_.fetch_add(1, std::memory_order_release);
        }
    }
    bool finished() const { return done_.load(std::memory_order_acquire) == blocks_; }
    /// Of the first block that failed; call it once finished.
    void rethrow() const {
        if (failure_) std::rethrow_exception(failure_);
    }

  private:
    const std::size_t blocks_;
    const std::function<void(std::size_t)> &body_;
    std::atomic<std::size_t> next_{0}, done_{0};
    std::atomic<bool> failed_{false};
    std::exception_ptr failure_;
};

class Team {
  public:
    /// As many workers as the system grants: it may have no thread left, or no memory for one.
    explicit Team(int workers) : wanted_(workers) {
        try {
            for (int i = 0; i < workers; ++i) threads_.emplace_back([this] { loop(); });
        } catch (const std::exception &) {
        }
    }
    ~Team() {
        {
            std::lock_guard<std::mutex> lock(mutex_);
            stopping_ = true;
        }
        wake_.notify_all();
        for (auto &thread : threads_) thread.join();
    }
    int wanted() const { return wanted_; }

    void run(std::size_t blocks, const std::function<void(std::size_t)> &body) {
        const auto job = std::make_shared<Job>(blocks, body);
        {
            std::lock_guard<std::mutex> lock(mutex_);
            job_ = job;
            ++generation_;
        }
        wake_.notify_all();
        job->work();
        wait_for([&] { return job->finished(); });
        {
            std::lock_guard<std::mutex> lock(mutex_);
            job_.reset();
        }
        job->rethrow();
    }

  private:
    void loop() {
        std::size_t seen = 0;
        for (;;) {
            std::shared_ptr<Job> job;
            {
                std::unique_lock<std::mutex> lock(mutex_);
                wake_.wait(lock, [&] { return stopping_ || generation_ != seen; });
                if (stopping_) return;
                seen = generation_;
                job = job_;
            }
            if (job) job->work();
        }
    }

    const int wanted_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::shared_ptr<Job> job_;
    std::size_t generation_ = 0;
    bool stopping_ = false;
    std::vector<std::thread> threads_;  // last, for they use the rest
};

std::atomic<int> wanted_threads{0};
std::mutex team_mutex;
Team *team = nullptr;  // never destroyed at exit: the operating system ends the workers with the process

Team &team_of(int workers) {
    if (team && team->wanted() != workers) {
        delete team;
        team = nullptr;
    }
    if (!team) team = new Team(workers);
    return *team;
}

}  // namespace

int thread_count() {
    int count = wanted_threads.load();
    if (count == 0) {
        count = default_thread_count();
        wanted_threads.store(count);
    }
    return count;
}

void set_thread_count(int count) { wanted_threads.store(std::clamp(count, 1, kMostThreads)); }

void parallel_for(std::size_t blocks, const std::function<void(std::size_t)> &body) {
    const int threads = thread_count();
    // A second caller while the team is at work computes alone instead of waiting.
    std::unique_lock<std::mutex> lock(team_mutex, std::defer_lock);
    if (blocks > 1 && threads > 1 && lock.try_lock()) {
        team_of(threads - 1).run(blocks, body);
        return;
    }
    for (std::size_t block = 0; block < blocks; ++block) body(block);
}

void hold_team() {
    team_mutex.lock();
    delete team;
    team = nullptr;
}

void release_team() { team_mutex.unlock(); }

}  // namespace sono
