"""Which transforms are followed, whose they are, and how many."""

import numpy as np
import pytest

from link_poses import turned
from sonospline.link import ScannerNames
from sonospline.link.coordinate_frames import CoordinateFrames
from sonospline.link.tool_tracking import ToolTracking


class Clock:
    """One that a test moves."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_names_that_clients_choose_are_bounded_and_a_refused_pose_owns_nothing():
    now = Clock()
    tracking = ToolTracking(CoordinateFrames(ScannerNames()), clock=now)
    tracking.reserve(["ProbeToTracker"], "aurora")
    assert not tracking.wants("ProbeToImage") and not tracking.wants("ImageToProbe"), "the simulator's own"
    with pytest.raises(ValueError, match="NeedleToReference"):
        tracking.take("NeedleToReference", np.full((4, 4), np.nan), source="rude")
    tracking.take("NeedleToReference", turned(1), source="plus")  # nobody else has it
    with pytest.raises(ValueError, match="one transform more than the 64 that are followed"):
        for number in range(100):
            tracking.take(f"NeedleToPlace{number}", turned(number), source="rude")
    tracking.take("ProbeToTracker", turned(2), source="aurora")
    tracking.take("ReferenceToTracker", turned(3), source="plus")
    for sender in ("rude", "polite"):  # who comes second hears why it is refused, not that the first has it
        with pytest.raises(ValueError, match="known already"):
            tracking.take("ProbeToReference", turned(4), source=sender)
    np.testing.assert_allclose(tracking.moving.get("ProbeToTracker"), turned(2), atol=1e-12)
    assert tracking.face() is not None
    with pytest.raises(ValueError, match="one transform more than the 64"):
        tracking.take("NeedleToElsewhere", turned(5), source="rude")
    now.now += 2.5  # its own are old: it may have others instead of them
    tracking.take("NeedleToElsewhere", turned(5), source="rude")
    assert "NeedleToPlace0" not in tracking.moving and "NeedleToPlace1" not in tracking.moving
    assert "NeedleToPlace2" in tracking.moving and "ReferenceToTracker" in tracking.moving


def test_who_comes_again_and_again_leaves_nothing_behind():
    now = Clock()
    tracking = ToolTracking(CoordinateFrames(ScannerNames()), clock=now)
    for number in range(90):
        now.now += 2.5
        tracking.take("NeedleToReference", turned(1), source=f"10.0.0.1:{number}")
        tracking.take(f"NeedleToPlace{number}", turned(2), source=f"10.0.0.1:{number}")
    assert len(tracking._clocks) == len(tracking._owners) - 1 == 64
    assert len(tracking.moving.frames) < 80
