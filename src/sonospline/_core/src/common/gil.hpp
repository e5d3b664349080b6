// The interpreter's lock, let go while the core computes.
#pragma once

#include <nanobind/nanobind.h>

#include <unistd.h>

#ifdef __GLIBCXX__
#include <cxxabi.h>
#endif

#include "common/forks.hpp"

/// What `body` returns, which may wait for the interpreter's lock.
///
/// Once the interpreter ends, Python up to 3.13 ends a daemon thread that wants the lock by pthread_exit, which glibc
/// does by an exception that no destructor lets pass: the process aborts. Such a thread sleeps here until the process
/// is gone, as Python 3.14 has it.
template <class Body> auto while_python_lives(const Body &body) {
#ifdef __GLIBCXX__
    try {
        return body();
    } catch (abi::__forced_unwind &) {
        for (;;) sleep(1000);  // to leave this block would abort, too
    }
#else
    return body();
#endif
}

/// Lets other Python threads run for as long as it lives.
class WithoutGil {
  public:
    WithoutGil() : state_(PyEval_SaveThread()) {}
    ~WithoutGil() {
        while_python_lives([this] { PyEval_RestoreThread(state_); });
    }
    WithoutGil(const WithoutGil &) = delete;
    WithoutGil &operator=(const WithoutGil &) = delete;

  private:
    PyThreadState *const state_;
};

/// What every call into the core holds while it computes; a fork does not wait for threads that wait for the lock.
class Outside {
    WithoutGil first_;
    sono::Computing then_;
};
