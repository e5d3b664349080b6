#include "parallel.hpp"

#include <sched.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace sono {
namespace {

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
struct Job {
    const std::function<void(std::size_t)> *body;
    std::size_t blocks;
    std::atomic<std::size_t> next{0};
    std::atomic<std::size_t> done{0};

    void work() {
        for (std::size_t block; (block = next.fetch_add(1)) < blocks;) {
            (*body)(block);
            done.fetch_add(1, std::memory_order_release);
        }
    }
    bool finished() const { return done.load(std::memory_order_acquire) == blocks; }
};

class Team {
  public:
    explicit Team(int workers) : pid_(getpid()) {
        for (int i = 0; i < workers; ++i) threads_.emplace_back([this] { loop(); });
    }
    ~Team() {
        if (pid_ != getpid()) {  // after fork() the threads do not exist here
            for (auto &thread : threads_) thread.detach();
            return;
        }
        {
            std::lock_guard<std::mutex> lock(mutex_);
            stopping_ = true;
        }
        wake_.notify_all();
        for (auto &thread : threads_) thread.join();
    }
    int workers() const { return static_cast<int>(threads_.size()); }
    bool belongs_to_this_process() const { return pid_ == getpid(); }

    void run(std::size_t blocks, const std::function<void(std::size_t)> &body) {
        auto job = std::make_shared<Job>();
        job->body = &body;
        job->blocks = blocks;
        {
            std::lock_guard<std::mutex> lock(mutex_);
            job_ = job;
            ++generation_;
        }
        wake_.notify_all();
        job->work();
        wait_for([&] { return job->finished(); });
        std::lock_guard<std::mutex> lock(mutex_);
        job_.reset();
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

    const pid_t pid_;
    std::vector<std::thread> threads_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::shared_ptr<Job> job_;
    std::size_t generation_ = 0;
    bool stopping_ = false;
};

std::atomic<int> wanted_threads{0};
std::mutex team_mutex;

// Never destroyed at exit: the operating system ends the workers with the process.
Team *&team_slot() {
    static Team *team = nullptr;
    return team;
}

Team &team_of(int workers) {
    Team *&team = team_slot();
    if (team && !team->belongs_to_this_process()) team = nullptr;  // leaked on purpose after fork()
    if (team && team->workers() != workers) {
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

void set_thread_count(int count) { wanted_threads.store(count < 1 ? 1 : count); }

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

}  // namespace sono
