// The force of a needle in the hand that holds it, tick by tick, on a contact with tissue that stands still.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

namespace sono {

using Vector3 = std::array<double, 3>;

/// What a tissue model knows of one needle at one moment: n points along it, of which `tip` is the tip's end of the
/// track (n: none). Millimetres and newtons; a force acts on the tissue, along the axis.
struct FrozenContact {
    std::size_t n, tip;
    std::vector<double> compliance;                          // (n, n)
    std::vector<double> places, displacement, forces, anchors, low, high;  // (n,)
    Vector3 axis, origin;                                    // of the needle; where its tip was
    double lateral_stiffness;
    Vector3 lateral_force;                                   // on the hand, where the tip was
};

/// How a hand is coupled to a contact, and what it is never to feel.
struct ForceOptions {
    double period, stiffness, damping;                     // s, N/mm, N s/mm
    double delay, hand_acceleration, hand_mass;            // s, mm/s2, N s2/mm
    double most_force, most_rate;                          // N, N/s
    double swap, swap_step;                                // s, N a tick
    double device_stale, contact_stale, fade;              // s
    double seed, most_stored;                              // N mm
    double withdrawn;                                      // mm
    int sweeps;
    double tolerance;                                      // mm
};

/// A contact with all the memory that a law needs for it: what is made by others, the law's thread never has to ask for.
struct PreparedContact {
    PreparedContact(FrozenContact given, const ForceOptions &options);

    FrozenContact contact;
    std::vector<double> compliance, base;                    // with the coupling's; apart from anchors, at rest
    std::vector<double> forces, anchors;                     // of now
    std::vector<double> apart, beyond, low, high;            // scratch
};

/// What a tick was given: where the device is, and how long ago it and the contact were heard of.
struct HandSample {
    Vector3 position;
    double device_age, contact_age;
};

/// One hand on one needle. A function of its samples and contacts alone: it knows no clock.
class ForceLaw {
  public:
    explicit ForceLaw(const ForceOptions &options);

    /// From the next tick on that hears of the hand.
    void renew(std::shared_ptr<PreparedContact> contact) noexcept;
    /// The force on the hand until the next tick.
    Vector3 tick(const HandSample &sample) noexcept;

    /// What is felt now; null before the first.
    const PreparedContact *contact() const { return contact_.get(); }
    /// How far the needle stays behind the device along its axis.
    double stretch() const { return stretch_; }
    double fade() const { return fade_; }
    /// Work that the loop may still do on the hand, whatever the delay, N mm.
    double stored() const;
    bool device_heard() const { return heard_; }
    bool contact_fresh() const { return fresh_; }

  private:
    static constexpr std::size_t kVelocityTicks = 4;

    void install(const Vector3 &position);
    void settle(const Vector3 &position);
    Vector3 contact_force(const Vector3 &position);
    void move_anchors();
    void account(const Vector3 &position);
    const Vector3 &last_place() const { return been_[(ticks_ + kVelocityTicks - 1) % kVelocityTicks]; }
    double passive_share(const Vector3 &force, double device_age) const;

    ForceOptions options_;
    std::shared_ptr<PreparedContact> contact_, next_;
    double stretch_ = 0, fade_ = 0, seed_ = 0, used_up_ = 0;
    std::vector<double> stored_;                       // by the delay that may be, ticks
    Vector3 offset_{}, limited_{}, wanted_{};
    double offset_left_ = 0, offset_step_ = 0;
    bool heard_ = false, fresh_ = false, placed_ = false;
    std::vector<Vector3> sent_;                        // ring of what may still act
    std::vector<double> work_;
    std::array<Vector3, kVelocityTicks> been_{};       // ring of positions
    std::size_t ticks_ = 0;
};

}  // namespace sono
