// The force in the hand in real time: a law in a thread of its own, at a steady rate, that waits for nobody.
#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "contact/force_law.hpp"

namespace sono {

/// So many numbers that one thread writes and others read whole; neither waits for the other.
template <std::size_t N> class Published {
  public:
    void write(const std::array<double, N> &values) {
        const std::uint64_t before = turn_.load(std::memory_order_relaxed);
        turn_.store(before + 1, std::memory_order_relaxed);
        std::atomic_thread_fence(std::memory_order_release);
        for (std::size_t i = 0; i < N; ++i) values_[i].store(values[i], std::memory_order_relaxed);
        turn_.store(before + 2, std::memory_order_release);
    }
    /// False where the writer was at it: ask again, or go on with what is known.
    bool read(std::array<double, N> &values) const {
        const std::uint64_t before = turn_.load(std::memory_order_acquire);
        if (before % 2) return false;
        std::array<double, N> seen;
        for (std::size_t i = 0; i < N; ++i) seen[i] = values_[i].load(std::memory_order_relaxed);
        std::atomic_thread_fence(std::memory_order_acquire);
        if (turn_.load(std::memory_order_relaxed) != before) return false;
        values = seen;
        return true;
    }

  private:
    std::atomic<std::uint64_t> turn_{0};
    std::array<std::atomic<double>, N> values_{};
};

/// Counts of durations in bins an eighth of an octave wide, from 0.1 us on.
class Durations {
  public:
    void add(double seconds);
    /// The upper end of the bin that holds the share, seconds; 0 where nothing was counted.
    double quantile(double share) const;
    void clear();

  private:
    static constexpr int kPerOctave = 8, kBins = 200;
    std::array<std::atomic<std::uint64_t>, kBins> counts_{};
};

class ForceLoop {
  public:
    explicit ForceLoop(const ForceOptions &options);
    ~ForceLoop();
    ForceLoop(const ForceLoop &) = delete;
    ForceLoop &operator=(const ForceLoop &) = delete;

    /// Begins to tick. Throws std::system_error where the system grants no thread.
    void start();
    /// Ends the thread; no force is left.
    void stop();
    /// Whether a thread ticks. After a fork there is none in the child.
    bool running() const;

    void publish(FrozenContact contact);
    void place(const Vector3 &position);

    struct Reading {
        Vector3 force;
        double advance, stretch, fade, stored, heard, fresh;
    };
    Reading read() const;

    Durations computed, late;
    std::atomic<std::uint64_t> ticks{0}, skipped{0};
    std::atomic<bool> real_time{false};  // whether the system let the thread run before all ordinary ones

  private:
    using Clock = std::chrono::steady_clock;
    using Renewal = std::pair<std::shared_ptr<PreparedContact>, double>;
    static double now();

    void run() noexcept;
    void tick() noexcept;
    bool ticks_here() const;  // with owner_

    const ForceOptions options_;
    mutable std::mutex owner_;                  // of those who start, stop, place and ask; never of the loop
    std::thread thread_;
    pid_t process_ = 0;
    std::atomic<bool> stopping_{false};
    Published<4> placed_;                       // position, and when
    Published<9> reading_;
    std::atomic<Renewal *> renewed_{nullptr};   // double buffer: the loop takes it, a newer one replaces it
    // Of the loop's thread alone, while there is one.
    std::unique_ptr<ForceLaw> law_;
    HandSample sample_{};
    double device_heard_, contact_heard_;
    std::shared_ptr<PreparedContact> contact_;
};

}  // namespace sono
