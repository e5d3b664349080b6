#include "contact/force_loop.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#ifdef __linux__
#include <sched.h>
#include <sys/prctl.h>
#endif

#include "common/forks.hpp"

namespace sono {
namespace {

constexpr double kLeast = 1e-7;  // s
constexpr double kNever = -std::numeric_limits<double>::infinity();

/// Has the calling thread run before all ordinary ones whenever it is due; false where the system does not grant it.
bool ask_for_real_time() {
#ifdef __linux__
    prctl(PR_SET_TIMERSLACK, 1);  // else the system may add 50 us to every wait
    const sched_param lowest{sched_get_priority_min(SCHED_FIFO)};  // above what is ordinary, below the system's own
    return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0;
#else
    return false;
#endif
}

}  // namespace

void Durations::add(double seconds) {
    const double bin = std::ceil(kPerOctave * std::log2(std::max(seconds, kLeast) / kLeast));
    counts_[static_cast<std::size_t>(std::min(bin, kBins - 1.0))].fetch_add(1, std::memory_order_relaxed);
}

double Durations::quantile(double share) const {
    std::array<std::uint64_t, kBins> counts;
    std::uint64_t all = 0;
    for (int i = 0; i < kBins; ++i) all += counts[i] = counts_[i].load(std::memory_order_relaxed);
    if (all == 0) return 0;
    std::uint64_t below = 0;
    int bin = 0;
    for (; bin < kBins - 1; ++bin) {
        below += counts[bin];
        if (static_cast<double>(below) >= share * static_cast<double>(all)) break;
    }
    return kLeast * std::exp2(static_cast<double>(bin) / kPerOctave);
}

void Durations::clear() {
    for (auto &count : counts_) count.store(0, std::memory_order_relaxed);
}

ForceLoop::ForceLoop(const ForceOptions &options) : options_(options), device_heard_(kNever), contact_heard_(kNever) {}

ForceLoop::~ForceLoop() {
    stop();
    delete renewed_.exchange(nullptr);
}

double ForceLoop::now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

bool ForceLoop::ticks_here() const { return thread_.joinable() && process_ == getpid(); }

bool ForceLoop::running() const {
    std::lock_guard<std::mutex> lock(owner_);
    return ticks_here();
}

void ForceLoop::start() {
    std::lock_guard<std::mutex> lock(owner_);
    if (ticks_here()) return;
    if (thread_.joinable()) thread_.detach();  // it is its parent's, and did not come along by the fork
    law_ = std::make_unique<ForceLaw>(options_);
    if (contact_) law_->renew(contact_);
    stopping_.store(false);
    process_ = getpid();
    thread_ = std::thread([this] { run(); });
}

void ForceLoop::stop() {
    std::lock_guard<std::mutex> lock(owner_);
    if (!thread_.joinable()) return;
    stopping_.store(true);
    if (ticks_here())
        thread_.join();
    else
        thread_.detach();
    reading_.write({});
}

void ForceLoop::publish(FrozenContact contact) {
    auto prepared = std::make_shared<PreparedContact>(std::move(contact), options_);
    delete renewed_.exchange(new Renewal(std::move(prepared), now()), std::memory_order_acq_rel);
}

void ForceLoop::place(const Vector3 &position) {
    std::lock_guard<std::mutex> lock(owner_);
    placed_.write({position[0], position[1], position[2], now()});
}

ForceLoop::Reading ForceLoop::read() const {
    std::array<double, 9> values{};
    while (!reading_.read(values)) std::this_thread::yield();
    const auto &[x, y, z, advance, stretch, fade, stored, heard, fresh] = values;
    return {{x, y, z}, advance, stretch, fade, stored, heard, fresh};
}

void ForceLoop::run() noexcept {
    real_time.store(ask_for_real_time(), std::memory_order_relaxed);
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(options_.period));
    for (auto due = Clock::now(); !stopping_.load(std::memory_order_relaxed); due += period) {
        std::this_thread::sleep_until(due);
        const auto began = Clock::now();
        late.add(std::chrono::duration<double>(began - due).count());
        {
            const Computing computing;
            tick();
        }
        const auto ended = Clock::now();
        computed.add(std::chrono::duration<double>(ended - began).count());
        ticks.fetch_add(1, std::memory_order_relaxed);
        for (; due + period < ended; due += period) skipped.fetch_add(1, std::memory_order_relaxed);
    }
}

void ForceLoop::tick() noexcept {
    if (const std::unique_ptr<Renewal> renewal{renewed_.exchange(nullptr, std::memory_order_acq_rel)}) {
        contact_ = renewal->first;
        contact_heard_ = renewal->second;
        law_->renew(contact_);
    }
    std::array<double, 4> placed;
    if (placed_.read(placed) && placed[3] > 0) {
        sample_.position = {placed[0], placed[1], placed[2]};
        device_heard_ = placed[3];
    }
    sample_.device_age = now() - device_heard_;
    sample_.contact_age = now() - contact_heard_;
    const Vector3 force = law_->tick(sample_);
    double advance = 0;
    if (const PreparedContact *felt = law_->contact())
        for (std::size_t i = 0; i < 3; ++i)
            advance += (sample_.position[i] - felt->contact.origin[i]) * felt->contact.axis[i];
    reading_.write({force[0], force[1], force[2], advance, law_->stretch(), law_->fade(), law_->stored(),
                    law_->device_heard() ? 1.0 : 0.0, law_->contact_fresh() ? 1.0 : 0.0});
}

}  // namespace sono
