#include "contact/force_law.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "contact/clipped_forces.hpp"

namespace sono {
namespace {

// A message comes a tick late at times, and now and then one is lost: then the one before it acts on.
constexpr std::size_t kUnsure = 3;

// So long after the worst case has used up what was stored, a hand gets half of the seed before: a hand that was dealt
// with too strictly feels again, and all seeds together are not twice the first.
constexpr double kRestart = 0.5;

// Ticks that a new contact may take at once to find its forces, and how little they change then, N.
constexpr int kSettling = 32;
constexpr double kSettled = 1e-4;

// No device is as far away; NaN is not within it, either.
constexpr double kReach = 1e5;

double dot(const Vector3 &a, const Vector3 &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double length(const Vector3 &a) { return std::sqrt(dot(a, a)); }
Vector3 sum(const Vector3 &a, double times, const Vector3 &b) {
    return {a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]};
}
Vector3 scaled(double times, const Vector3 &a) { return sum({}, times, a); }
Vector3 at_most(double most, const Vector3 &a) {
    const double size = length(a);
    return size > most ? scaled(most / size, a) : a;
}
bool within_reach(const Vector3 &a) {
    return std::all_of(a.begin(), a.end(), [](double x) { return std::fabs(x) <= kReach; });
}

}  // namespace

PreparedContact::PreparedContact(FrozenContact given, const ForceOptions &options)
    : contact(std::move(given)), compliance(contact.compliance), base(contact.n), forces(contact.forces),
      anchors(contact.anchors), apart(contact.n), beyond(contact.n), low(contact.n), high(contact.n) {
    const double coupling = 1 / (options.stiffness + options.damping / options.period);
    for (std::size_t i = 0; i < contact.n; ++i) {
        base[i] = contact.displacement[i] + contact.places[i];
        for (std::size_t j = 0; j < contact.n; ++j) {
            base[i] -= contact.compliance[i * contact.n + j] * contact.forces[j];
            compliance[i * contact.n + j] += coupling;
        }
    }
}

ForceLaw::ForceLaw(const ForceOptions &options) : options_(options) {
    const auto delays = static_cast<std::size_t>(std::ceil(options.delay / options.period)) + 1;
    stored_.assign(delays, options.seed);
    seed_ = options.seed;
    sent_.assign(delays + kUnsure - 1, Vector3{});
    work_.assign(sent_.size(), 0);
}

void ForceLaw::renew(std::shared_ptr<PreparedContact> contact) noexcept { next_ = std::move(contact); }

Vector3 ForceLaw::tick(const HandSample &sample) noexcept {
    heard_ = within_reach(sample.position) && sample.device_age <= options_.device_stale;
    if (heard_) {
        account(sample.position);
        been_[ticks_ % kVelocityTicks] = sample.position;
        if (next_)
            install(sample.position);
        else if (contact_)
            wanted_ = contact_force(sample.position);
        offset_left_ = std::max(0.0, offset_left_ - offset_step_);
    } else {
        been_[ticks_ % kVelocityTicks] = last_place();
    }
    fresh_ = contact_ && sample.contact_age <= options_.contact_stale;
    const double fading = options_.period / options_.fade;
    fade_ = std::clamp(fade_ + (heard_ && fresh_ ? fading : -fading), 0.0, 1.0);

    const Vector3 target = at_most(options_.most_force, sum(wanted_, offset_left_, offset_));
    limited_ = sum(limited_, 1, at_most(options_.most_rate * options_.period, sum(target, -1, limited_)));
    const Vector3 shown = scaled(fade_, limited_);
    const Vector3 force = scaled(passive_share(shown, sample.device_age), shown);
    sent_[ticks_++ % sent_.size()] = force;
    return force;
}

// The new contact's own force may differ from what the hand feels now: the difference is given back little by little.
void ForceLaw::install(const Vector3 &position) {
    contact_ = std::exchange(next_, nullptr);
    settle(position);
    offset_ = sum(limited_, -1, wanted_);
    offset_left_ = 1;
    const double ticks = std::max(options_.swap / options_.period, length(offset_) / options_.swap_step);
    offset_step_ = 1 / ticks;
}

// As if time stood still for the hand: what a new contact finds by itself in its first ticks is none of its motion.
void ForceLaw::settle(const Vector3 &position) {
    for (int tick = 0; tick < kSettling; ++tick) {
        const Vector3 before = wanted_;
        wanted_ = contact_force(position);
        if (length(sum(wanted_, -1, before)) < kSettled) return;
    }
}

// The coupling is a spring and a damper between device and needle. In one unknown step of time it is one more
// compliance, 1 / (K + B / dt), shared by all points, so that tissue, friction and coupling are solved at once.
Vector3 ForceLaw::contact_force(const Vector3 &position) {
    auto &[c, compliance, base, forces, anchors, apart, beyond, low, high] = *contact_;
    const Vector3 moved = sum(position, -1, c.origin);
    const double advance = dot(moved, c.axis);
    const double damping = options_.damping / options_.period, coupling = 1 / (options_.stiffness + damping);
    const double kept = coupling * damping * stretch_;
    for (std::size_t i = 0; i < c.n; ++i) {
        // Beyond the tip there is no needle that could hold on to tissue.
        const double held = i == c.tip ? 1 : std::clamp(1 + anchors[i] / options_.withdrawn, 0.0, 1.0);
        low[i] = held * c.low[i];
        high[i] = held * c.high[i];
        apart[i] = base[i] + anchors[i] - (advance - kept);
    }
    const Contact contact{compliance.data(), apart.data(), low.data(), high.data(), c.n};
    clipped_forces(contact, forces.data(), beyond.data(), options_.sweeps, options_.tolerance);
    move_anchors();

    double axial = 0;
    for (const double force : forces) axial += force;
    stretch_ = kept + coupling * axial;
    Vector3 force = sum(c.lateral_force, -axial, c.axis);
    if (c.lateral_stiffness > 0) {
        const Vector3 aside = sum(moved, -advance, c.axis);
        force = sum(force, -1 / (1 / c.lateral_stiffness + 1 / options_.stiffness), aside);
    }
    return force;
}

// Where a force is at its bound the needle slips, and holds on to tissue elsewhere from now on. The tip does so
// where it cuts alone: pulled back, it leaves the end of its track where it is.
void ForceLaw::move_anchors() {
    PreparedContact &c = *contact_;
    for (std::size_t i = 0; i < c.contact.n; ++i) {
        const bool forward = c.forces[i] >= c.high[i] && c.beyond[i] < 0;
        const bool backward = c.forces[i] <= c.low[i] && c.beyond[i] > 0 && i != c.contact.tip;
        if (forward || backward) c.anchors[i] -= c.beyond[i];
    }
}

// The delay is not known: what was done to the hand is at most the work of the worst of them. And each may be longer
// for a moment, so that of a few forces the worst one counts.
void ForceLaw::account(const Vector3 &position) {
    if (!placed_) been_.fill(position);
    placed_ = true;
    const Vector3 way = sum(position, -1, last_place());
    const std::size_t room = sent_.size();
    for (std::size_t ago = 0; ago < room; ++ago) work_[ago] = dot(sent_[(ticks_ + room - 1 - ago) % room], way);
    for (std::size_t delay = 0; delay < stored_.size(); ++delay) {
        const double most = *std::max_element(&work_[delay], &work_[delay] + kUnsure);
        stored_[delay] = std::min(stored_[delay] - most, options_.most_stored);
    }
    used_up_ = stored() > 0 ? 0 : used_up_ + options_.period;
    if (used_up_ < kRestart) return;
    seed_ /= 2;
    stored_.assign(stored_.size(), seed_);
    used_up_ = 0;
}

double ForceLaw::stored() const { return *std::min_element(stored_.begin(), stored_.end()); }

// The share of a force that does no more work than is stored, wherever the hand may go, unseen, while it acts: on at
// its speed, and drawn along by its own strength and by the force.
double ForceLaw::passive_share(const Vector3 &force, double device_age) const {
    const double size = length(force);
    if (size == 0) return 1;
    const double most = stored();
    if (!(most > 0)) return 0;
    const double period = options_.period, unseen = options_.delay + std::max(0.0, device_age) + kUnsure * period;
    const Vector3 &here = been_[ticks_ % kVelocityTicks], &before = been_[(ticks_ + 1) % kVelocityTicks];
    const double along = dot(sum(here, -1, before), force) / size / ((kVelocityTicks - 1) * period);
    const double late = unseen + kVelocityTicks * period / 2;
    // On a way along the force what is stored falls, and forces that were sent before, stronger ones, act on it, too.
    const double drift = along > 0 ? 2 * along : along;
    const double once = size * (drift * unseen + options_.hand_acceleration * late * late / 2);
    const double twice = size * size * unseen * unseen / (2 * options_.hand_mass);
    // share * once + share^2 * twice = most
    return std::min(1.0, 2 * most / (once + std::sqrt(once * once + 4 * twice * most)));
}

}  // namespace sono
