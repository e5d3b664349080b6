// fork() copies memory as it is, whatever other threads are at: a mutex that one of them holds stays locked for ever in
// the child, and what it was changing stays half changed. So a fork waits here until no thread computes, and threads
// that want to compute wait until it is over.
#pragma once

namespace sono {

/// Held by a thread that computes. Taken before any mutex of an object, and never twice by one thread.
class Computing {
  public:
    Computing();
    ~Computing();
    Computing(const Computing &) = delete;
    Computing &operator=(const Computing &) = delete;
};

/// Makes forks wait. Called once, when the module is loaded.
void watch_forks();

}  // namespace sono
