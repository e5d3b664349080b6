"""The force of a needle that leaves a track, in a hand: the loop goes on where the model stopped."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.link import Coupling, FakeDevice
from sonospline.mechanics import Material
from sonospline.models.elastic import ElasticModel

TISSUE = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
ENTRY, X = np.array([0.0, 45.0, 52.0]), np.eye(3)[0]


def needle(depth):
    return {"needle": ss.Needle(ENTRY, ENTRY + np.array([depth, 0.0, 0.0]))}


def going(depth, speed, since):
    """Where a hand wants to be that goes on from a depth."""
    return lambda now: ENTRY + (depth + speed * (now - since)) * X


def test_a_hand_and_the_model_push_a_needle_in_and_pull_it_back_together():
    """The model follows the needle in the hand, thirty times a second, and tells the hand what holds it."""
    model = ElasticModel(TISSUE, Material(10.0), nodes=11**3, contact="track")
    coupling, frame = Coupling(delay_ms=0), 1 / 30
    response = model.step(model.rest, needle(1.0), 0.1)
    device = FakeDevice(ENTRY + np.array([1.0, 0, 0]), coupling, delay_ms=0)
    hand, felt, meant = 1.0, [], []
    for speed in [20.0] * 45 + [-20.0] * 18:
        device.renew(model.snapshot(response, "needle"))
        moved = device.move(going(hand, speed, len(felt) * frame), frame)
        hand += speed * frame
        felt.append(-moved.forces_n[-1, 0, 0])
        depth = moved.positions_mm[-1, 0, 0] - felt[-1] / coupling.stiffness_n_mm  # the needle hangs on the hand
        response = model.step(response.state, needle(depth), frame)
        meant.append(response.forces["needle"].axial_n)
    assert meant[44] > 1.3 and meant[-1] < -0.2
    assert np.abs(np.array(felt[1:]) - meant[1:]).max() < 0.06 * max(meant)


def test_what_holds_nothing_is_refused_in_a_line():
    posed = ElasticModel(TISSUE, Material(10.0), nodes=9**3)
    with pytest.raises(ValueError, match="make the model with contact='track'"):
        posed.snapshot(posed.step(posed.rest, needle(20.0)), "needle")
    tracked = ElasticModel(TISSUE, Material(10.0), nodes=9**3, contact="track")
    with pytest.raises(ValueError, match="needle = 'other'"):
        tracked.snapshot(tracked.step(tracked.rest, needle(20.0)), "other")
