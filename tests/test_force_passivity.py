"""What a loop gives to hands is never more than they put in, whatever the wire between them does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from builds import needs_core
from force_hands import random_hands, shaft
from sonospline import _core
from sonospline._core.twin.force_law import ForceLaw as TwinLaw
from sonospline.link import Coupling, FakeDevice
from sonospline.link.coupling import SWEEPS

MOST_J = 1e-6


def felt_by(count, stiffness, seconds, seed):
    hands, wanted = random_hands(count, seed)
    device = FakeDevice((0, 0, 0), Coupling(stiffness_n_mm=stiffness), **hands)
    device.renew(shaft(8))
    return device.move(wanted, seconds)


@pytest.mark.parametrize("share", [1.0, pytest.param(0.2, marks=pytest.mark.slow)])
def test_some_random_hands_are_given_nothing(share):
    felt = felt_by(50, share * Coupling().stiffest_n_mm, 0.5, seed=5)
    assert felt.given_j.max() < MOST_J
    assert np.median(np.linalg.norm(felt.forces_n[-1], axis=1)) > 0.2  # no force would give nothing, either


@needs_core
@pytest.mark.slow
def test_ten_thousand_random_hands_are_given_nothing():
    """Delay 0 to 5 ms, jitter, 5 % lost each way, three stiffnesses up to the stated limit."""
    most = []
    for seed, (share, count) in enumerate(((0.2, 3300), (0.6, 3300), (1.0, 3400))):
        felt = felt_by(count, share * Coupling().stiffest_n_mm, 0.7, seed)
        assert np.median(np.linalg.norm(felt.forces_n[-1], axis=1)) > 0.2
        most.append(felt.given_j.max())
    assert max(most) < MOST_J


def test_without_the_controller_the_same_hands_are_given_much(monkeypatch):
    """What is held back above is there to be held back: the seed is all there would have to be in store."""
    monkeypatch.setattr("sonospline.link.coupling.MAY_GIVE_J", 0.01)
    assert felt_by(50, Coupling().stiffest_n_mm, 0.5, seed=5).given_j.max() > 100 * MOST_J


def test_a_contact_that_pushes_by_itself_gives_no_more_than_was_put_in():
    """Tissue that is given as pressed together, on a hand that did not press it."""
    contact = shaft(12, lateral=0.0)
    pressed = {name: getattr(contact, name) for name in contact.__dataclass_fields__}
    pressed |= {"forces_n": contact.high_n.copy(), "displacement_mm": contact.compliance_mm_n @ contact.high_n}
    pressed["anchors_mm"] = -contact.places_mm - pressed["displacement_mm"]
    device = FakeDevice((0, 0, 0), stiffness_n_mm=0.02, delay_ms=3.0)
    device.renew(type(contact)(**pressed))
    felt = device.move(lambda t: (0.0, 0.0, 0.0), seconds=0.5)
    assert felt.given_j.max() < MOST_J


@pytest.mark.parametrize(("delay", "within_mm"), [(5.0, 5.0), pytest.param(1.0, 1.5, marks=pytest.mark.slow)])
def test_the_first_push_is_whole_after_some_millimetres(delay, within_mm, monkeypatch):
    felt = []
    for seed in (None, 0.05):
        if seed is not None:
            monkeypatch.setattr("sonospline.link.coupling.MAY_GIVE_J", seed)
        hand = {"stiffness_n_mm": 5.0, "damping_n_s_mm": 0.02, "delay_ms": delay}
        device = FakeDevice((0, 0, 0), Coupling(delay_ms=delay), **hand)
        device.renew(shaft(12))
        felt.append(device.move(lambda t: (0.0, 0.0, 10 * t), seconds=0.7))
    reached = felt[0].positions_mm[:, 0, 2] > within_mm
    held_back, whole = (each.forces_n[reached, 0, 2] for each in felt)
    assert (held_back / whole > 0.99).all()


@needs_core
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_core_and_twin_agree_tick_by_tick(seed):
    rng = np.random.default_rng(seed)
    coupling, hands = Coupling(delay_ms=float(rng.uniform(0, 5))), 2
    laws = [kind(hands, coupling.for_core(), SWEEPS) for kind in (_core.native.ForceLaw, TwinLaw)]
    at = np.zeros((hands, 3))
    for k in range(140):
        if k in (0, 70, 75, 120):
            contact = shaft(int(rng.integers(2, 9)), softness=rng.uniform(0.5, 2), tip_mm=(0, 0, rng.uniform(-1, 1)))
            for law in laws:
                law.renew(**contact.for_core())
        at = at + rng.normal(size=(hands, 3)) * (0.01, 0.01, 0.05) + (0, 0, 0.05 * np.sign(np.sin(k / 20)))
        seen, age = at.copy(), rng.choice([0.0, 0.001, 0.003, 0.05], hands, p=[0.6, 0.2, 0.15, 0.05])
        seen[rng.random(hands) < 0.03] = rng.choice([np.nan, np.inf, 1e200])
        ours, theirs = (law.tick(seen, age, 0.2 if 130 < k < 140 else 0.01) for law in laws)
        np.testing.assert_allclose(ours, theirs, atol=1e-9)
    for ours, theirs in zip(laws[0].state(), laws[1].state(), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)
