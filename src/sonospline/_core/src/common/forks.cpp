#include "common/forks.hpp"

#include <pthread.h>

#include <atomic>

#include "common/buffers.hpp"
#include "common/parallel.hpp"

namespace sono {
namespace {

// Plain numbers: the child could not use a condition variable on which threads of its parent wait.
std::atomic<int> computing{0}, forks{0};

void before_fork() {
    forks.fetch_add(1);
    wait_for([] { return computing.load() == 0; });
    hold_team();
    hold_buffers();
}

void after_fork() {
    release_buffers();
    release_team();
    forks.fetch_sub(1);
}

// Of the threads there were, only this one is left: nobody else is on the way in.
void in_child() {
    release_buffers();
    release_team();
    computing.store(0);
    forks.store(0);
}

}  // namespace

Computing::Computing() {
    for (;;) {
        computing.fetch_add(1);
        if (forks.load() == 0) return;
        computing.fetch_sub(1);
        wait_for([] { return forks.load() == 0; });
    }
}

Computing::~Computing() { computing.fetch_sub(1); }

void watch_forks() { pthread_atfork(before_fork, after_fork, in_child); }

}  // namespace sono
