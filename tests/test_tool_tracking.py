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
    np.testing.assert_allclose(tracking.face(), np.linalg.inv(turned(3)) @ turned(2), atol=1e-9)
    with pytest.raises(ValueError, match="one transform more than the 64"):
        tracking.take("NeedleToElsewhere", turned(5), source="rude")
    now.now += 2.5  # its own are old: it may have others instead of them
    tracking.take("NeedleToElsewhere", turned(5), source="rude")
    assert "NeedleToPlace0" not in tracking.moving and "NeedleToPlace1" not in tracking.moving
    assert "NeedleToPlace2" in tracking.moving and "ReferenceToTracker" in tracking.moving


def test_poses_of_real_trackers_are_taken_as_the_nearest_rigid_ones():
    """An electromagnetic tracker's, whose axes are off by 4e-4: from PLUS's recording WaterTankBottomTranslation."""
    rows = [[0.0087153, -0.161504, 0.986973, 194.556], [0.127109, 0.979214, 0.159142, -32.4817],
            [-0.991883, 0.124029, 0.0291359, 5.69268], [0, 0, 0, 1]]  # fmt: skip
    tracking = ToolTracking(CoordinateFrames(ScannerNames()))
    tracking.take("NeedleToReference", rows, source="plus")
    tip = tracking.tip()
    np.testing.assert_allclose(tip, rows, atol=3e-4)
    np.testing.assert_allclose(tip[:3, :3].T @ tip[:3, :3], np.eye(3), atol=1e-12)
    for wrong in (np.diag([1.01, 1, 1, 1]), np.array([[1, 0.02, 0, 0], *np.eye(4)[1:]])):
        with pytest.raises(ValueError, match="is not rigid"):
            tracking.take("NeedleToReference", wrong, source="plus")


def test_who_comes_again_and_again_leaves_nothing_behind():
    now = Clock()
    tracking = ToolTracking(CoordinateFrames(ScannerNames()), clock=now)
    for number in range(90):
        now.now += 2.5
        tracking.take("NeedleToReference", turned(1), source=f"10.0.0.1:{number}")
        tracking.take(f"NeedleToPlace{number}", turned(2), source=f"10.0.0.1:{number}")
    assert len(tracking._clocks) == len(tracking._owners) - 1 == 64
    assert len(tracking.moving.frames) < 80
