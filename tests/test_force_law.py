"""The force in the hand in virtual time: the contact's law, the coupling, its limits, and how it ends."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from force_hands import shaft
from sonospline import _core
from sonospline.link import Coupling, FakeDevice
from sonospline.link.coupling import SWEEPS

DIRECT = Coupling(delay_ms=0.0, stiffness_n_mm=2.0)


@pytest.fixture(autouse=True)
def plenty_in_store(monkeypatch):
    """The controller holds nothing back: what it does is in a file of its own."""
    monkeypatch.setattr("sonospline.link.coupling.MAY_GIVE_J", 0.05)


def held(law, advance, ticks, *, age=0.0, contact_age=0.0):
    """Forces along z on a hand that is held there."""
    at = np.array([[0.0, 0.0, advance]])
    return np.array([law.tick(at, np.array([age]), contact_age)[0, 2] for _ in range(ticks)])


def along(law, path, **age):
    return np.concatenate([held(law, advance, 1, **age) for advance in path])


def law_of(contact, coupling=DIRECT):
    law = _core.active.ForceLaw(1, coupling.for_core(), SWEEPS)
    law.renew(**contact.for_core())
    return law


def pushed(contact, coupling=DIRECT, speed_mm_s=20.0, to=10.0):
    """A law that has been pushed far enough to have friction everywhere, and energy in store."""
    law = law_of(contact, coupling)
    held(law, 0, 60)
    return law, along(law, np.arange(0, to, speed_mm_s * coupling.period_ms / 1000))


class Statically:
    """The same law as its text has it: bounds and targets, solved by a least-squares solver, step by step."""

    def __init__(self, contact, stiffness):
        self.contact, self.advance = contact, 0.0
        self.compliance = contact.compliance_mm_n + 1 / stiffness  # the coupling's spring is in series with all
        self.root = np.linalg.cholesky(self.compliance)
        self.anchors, self.forces = contact.anchors_mm.copy(), contact.forces_n.copy()

    def move(self, advance, steps=12):
        for at in np.linspace(self.advance, advance, steps + 1)[1:]:
            targets = at - self.contact.places_mm - self.anchors
            solved = lsq_linear(
                self.root.T, np.linalg.solve(self.root, targets),
                (self.contact.low_n - 1e-12, self.contact.high_n + 1e-12), tol=1e-12,
            )  # fmt: skip
            self.forces = solved.x
            beyond = self.compliance @ self.forces - targets
            slips = np.abs(beyond) > 1e-7
            slips[-1] &= self.forces[-1] > self.contact.high_n[-1] / 2
            self.anchors[slips] -= beyond[slips]
        self.advance = advance
        return -self.forces.sum()


def test_the_settled_force_is_that_of_the_quasi_static_law():
    contact = shaft(10)
    law, oracle, peak, at = law_of(contact), Statically(contact, DIRECT.stiffness_n_mm), 0.45 + 0.7, 0.0
    held(law, 0, 60)
    for there in (0.4, 6.0, 5.2, 1.0, 4.0):
        along(law, np.linspace(at, there, 200))
        at = there
        settled = held(law, there, 200)
        assert settled[-1] == pytest.approx(oracle.move(there), abs=0.02 * peak)
        assert np.ptp(settled[-50:]) < 1e-3


def test_sliding_in_and_out_is_friction_both_ways_and_cutting_one():
    law, forces = pushed(shaft(12), to=15)
    assert forces[-1] == pytest.approx(-(11 * 0.05 + 0.7), rel=0.02)
    out = along(law, np.arange(15, 9, -0.02))
    assert out[-1] == pytest.approx(11 * 0.05, rel=0.05)
    again = along(law, np.arange(9, 13.5, 0.02))
    assert again[-1] == pytest.approx(-11 * 0.05, rel=0.05)  # in its own track the tip cuts nothing
    assert along(law, np.arange(13.5, 18, 0.02))[-1] == pytest.approx(-(11 * 0.05 + 0.7), rel=0.02)


def test_a_needle_that_is_pulled_out_lets_go_point_by_point():
    law, _ = pushed(shaft(12))
    out = along(law, np.arange(10, -30, -0.02))
    assert np.abs(np.diff(out)).max() < 0.05
    assert np.abs(out[-100:]).max() < 1e-3


def test_the_needle_stays_behind_the_device_by_the_coupling_alone():
    law, forces = pushed(shaft(12))
    assert law.state()[2][0, 0] == pytest.approx(-forces[-1] / DIRECT.stiffness_n_mm, rel=0.02)


def test_aside_of_the_needle_tissue_and_coupling_push_back_in_series():
    law, _ = pushed(shaft(12, lateral=0.3))
    aside = [law.tick(np.array([[1.0, 0, 10.0]]), np.zeros(1), 0.0) for _ in range(100)][-1]
    assert aside[0, 0] == pytest.approx(-1 / (1 / 0.3 + 1 / 2.0), rel=1e-6)


@pytest.mark.parametrize("softness", [0.5, 0.9, 1.5])
def test_a_renewed_contact_steps_the_force_by_little(softness):
    """The hand is held; the new contact would have another force by far, and in time it has."""
    law, _ = pushed(shaft(12, friction=0.15, cutting=2.0))
    before = held(law, 10, 100)
    law.renew(**shaft(12, softness=softness, tip_mm=(0, 0, 8.5)).for_core())
    after = held(law, 10, 300)
    steps = np.abs(np.diff(np.concatenate([before[-1:], after])))
    assert steps.max() <= 0.05
    assert abs(after[-1] - before[-1]) > 0.5  # what is given back is more than ten such steps
    assert np.ptp(after[-50:]) < 1e-3


def test_contacts_renewed_faster_than_they_are_faded_over_step_little_too():
    law, _ = pushed(shaft(12))
    rng, steps, last = np.random.default_rng(3), [], held(law, 10, 1)[-1]
    for _ in range(60):
        law.renew(**shaft(12, softness=rng.uniform(0.5, 2), tip_mm=(0, 0, rng.uniform(7, 9.9))).for_core())
        felt = held(law, 10, 5)
        steps.append(np.abs(np.diff([last, *felt])).max())
        last = felt[-1]
    assert max(steps) <= 0.05


def test_forces_are_within_newtons_and_newtons_a_second():
    coupling = Coupling(delay_ms=0.0, stiffness_n_mm=2.0, most_force_n=0.8, most_rate_n_s=20.0)
    law, slow = pushed(shaft(12), coupling)
    assert slow.min() == pytest.approx(-0.8)
    jumps = along(law, [14.0] * 50 + [6.0] * 50 + [14.0] * 50)
    assert np.abs(jumps).max() <= 0.8 + 1e-12
    strength = np.diff(np.abs(jumps))
    assert strength.max() <= 20.0 / 1000 + 1e-12


@pytest.mark.parametrize("how", ["NaN", "infinity", "silence", "stale contact"])
def test_forces_fade_out_and_the_last_state_stays(how):
    law, _ = pushed(shaft(12))
    steady = held(law, 10, 50)[-1]
    state = [part.copy() for part in law.state()[:2]]
    where, age = {"NaN": np.nan, "infinity": np.inf}.get(how, 10.0), {"silence": 0.021}.get(how, 0.0)
    fading = held(law, where, 60, age=age, contact_age=0.101 if how == "stale contact" else 0.0)
    assert abs(steady) > 1
    assert (np.diff(np.abs(fading)) <= 1e-12).all()
    assert np.abs(np.diff([steady, *fading])).max() < 0.05
    assert fading[-1] == 0
    if how != "stale contact":
        assert all(map(np.array_equal, state, law.state()[:2]))
    back = held(law, 10, 120)
    assert back[-1] == pytest.approx(steady, abs=1e-3)
    assert np.abs(np.diff(back)).max() < 0.05


@pytest.mark.parametrize("delay", [5.0, *(pytest.param(ms, marks=pytest.mark.slow) for ms in (0.0, 1.0, 2.5))])
def test_a_hand_that_holds_still_feels_no_limit_cycle(delay):
    """At the stated limit of the stiffness, with the least damping that it allows, all delay, loss and quanta."""
    least = Coupling(delay_ms=delay)
    device = FakeDevice(
        (0, 0, 0), Coupling(delay_ms=delay, stiffness_n_mm=least.stiffest_n_mm), hands=6, delay_ms=delay, loss=0.05,
        mass_kg=np.repeat([0.2, 0.35], 3), damping_n_s_mm=least.hand_damping_n_s_mm,
        stiffness_n_mm=np.tile([0.1, 0.4, 1.0], 2), quantum_mm=0.005,
    )  # fmt: skip
    device.renew(shaft(12, softness=0.3, friction=0.2))
    device.move(lambda t: (0.0, 0.0, min(40 * t, 12.0)), seconds=0.4)
    device.move(lambda t: (0.0, 0.0, 12.0), seconds=1.4)  # until the hand's own spring is at rest
    felt = device.move(lambda t: (0.0, 0.0, 12.0), seconds=0.2).forces_n
    assert np.linalg.norm(felt, axis=2).min() > 0.3
    assert np.ptp(felt, axis=0).max() < 0.02
