// Faults on demand, in builds for tests alone: the linker leads what the core allocates, and the threads it starts,
// through here (--wrap).
#include "common/faults.hpp"

#include <atomic>
#include <cstdlib>
#include <memory>
#include <new>
#include <system_error>
#include <thread>
#include <utility>

namespace sono {
namespace {

std::atomic<long> allocations_left{-1}, threads_left{-1};

// Whether this is the one that fails: those before it count down, those after it, and all where nothing was asked, pass.
bool fails() { return allocations_left.load() >= 0 && allocations_left.fetch_sub(1) == 0; }

// From the one that fails on, all do.
bool no_thread() {
    if (threads_left.load() < 0) return false;
    if (threads_left.fetch_sub(1) > 0) return false;
    threads_left.store(0);
    return true;
}

}  // namespace

void fail_allocation(long after) { allocations_left.store(after); }
bool allocation_failed() { return allocations_left.load() < 0; }
void fail_threads(long after) { threads_left.store(after); }

}  // namespace sono

extern "C" {

void *__real__Znwm(std::size_t size);
void *__wrap__Znwm(std::size_t size) {
    if (sono::fails()) throw std::bad_alloc();
    return __real__Znwm(size);
}

void *__real_aligned_alloc(std::size_t alignment, std::size_t size);
void *__wrap_aligned_alloc(std::size_t alignment, std::size_t size) {
    return sono::fails() ? nullptr : __real_aligned_alloc(alignment, size);
}

// std::thread::_M_start_thread(std::unique_ptr<std::thread::_State>, void (*)())
void __real__ZNSt6thread15_M_start_threadESt10unique_ptrINS_6_StateESt14default_deleteIS1_EEPFvvE(
    std::thread *thread, std::unique_ptr<std::thread::_State> state, void (*depend)());
void __wrap__ZNSt6thread15_M_start_threadESt10unique_ptrINS_6_StateESt14default_deleteIS1_EEPFvvE(
    std::thread *thread, std::unique_ptr<std::thread::_State> state, void (*depend)()) {
    if (sono::no_thread()) throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
    __real__ZNSt6thread15_M_start_threadESt10unique_ptrINS_6_StateESt14default_deleteIS1_EEPFvvE(thread, std::move(state),
                                                                                               depend);
}
}
