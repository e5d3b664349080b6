"""The force loop in real time: it ticks by itself, says what it is at, and lets go of devices in one clear line."""

import gc
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from builds import needs_core
from force_hands import shaft
from sonospline import _core
from sonospline.contact import FrozenContact
from sonospline.link import Coupling, DeviceLimits, DeviceState, ForceLoop

pytestmark = needs_core

SOON_S = 5.0


def until(condition):
    """Wait for what is to come soon; return whether it came."""
    end = time.monotonic() + SOON_S
    while not (met := condition()) and time.monotonic() < end:
        time.sleep(0.002)
    return met


class Hand:
    """A device that is pushed steadily and keeps the forces that it is given."""

    def __init__(self, name="hand", speed_mm_s=40.0, at=None):
        self.name, self.limits, self.forces, self.closed = name, DeviceLimits(0.5), [], 0
        self.began, self.speed, self.at = time.monotonic(), speed_mm_s, at

    def read(self):
        time.sleep(0.001)
        gone = self.speed * (time.monotonic() - self.began)
        return DeviceState((0.0, 0.0, gone) if self.at is None else self.at)

    def write(self, force_n):
        self.forces.append(force_n)

    def close(self):
        self.closed += 1


def tasks():
    """Threads of this process, where they can be counted."""
    return len(list(Path("/proc/self/task").glob("*")))


def kept_fresh(loop, contact, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        loop.publish(contact)
        time.sleep(0.01)


def test_a_hand_that_pushes_feels_the_tissue():
    with ForceLoop() as loop:
        hand = Hand()
        loop.attach(hand)
        kept_fresh(loop, shaft(12), 0.5)
        reading, timing = loop.reading, loop.timing
    assert reading.axial_n < -0.3
    assert reading.stretch_mm > 0.2
    assert reading.state == "felt"
    assert hand.forces
    assert max(np.linalg.norm(force) for force in hand.forces) <= 0.5 + 1e-12  # the device's own limit
    assert hand.closed == 1
    assert timing.ticks + timing.skipped > 300
    assert 0 < timing.compute_p50_ms <= timing.compute_p99_ms


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="a system without POSIX scheduling")
def test_the_loop_runs_before_ordinary_programs_where_the_system_lets_it():
    granted = []

    def ask():  # of a thread of its own, which ends with what it was granted
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
            granted.append(True)
        except PermissionError:
            granted.append(False)

    asking = threading.Thread(target=ask)
    asking.start()
    asking.join()
    with ForceLoop() as loop:
        kept_fresh(loop, shaft(), 0.05)
        assert loop.timing.real_time is granted[0]
    assert os.sched_getscheduler(0) == os.SCHED_OTHER  # only that thread


def test_the_loop_says_what_it_waits_for_and_why_it_fades():
    with ForceLoop() as loop:
        assert loop.reading.state == "no contact yet"
        loop.publish(shaft())
        assert loop.reading.state == "no device yet"
        loop.move_to((0, 0, 0))
        assert until(
            lambda: "tissue is older than 100 ms" in loop.reading.state or "says nothing" in loop.reading.state
        )
        loop.publish(shaft())
        loop.move_to((np.nan, 0, 0))
        assert until(lambda: loop.reading.state == "force is gone: the device says nothing finite since 20 ms")
    assert loop.reading.state == "stopped"
    assert loop.reading.force_n == (0, 0, 0)


def test_two_devices_for_one_needle_are_refused_in_a_line():
    with ForceLoop() as loop:
        loop.attach(Hand("left"))
        with pytest.raises(ValueError, match=r"^device = 'right' comes second: the needle is in the hand of 'left'; "):
            loop.attach(Hand("right"))
        loop.detach()
        loop.attach(Hand("right"))


def test_a_device_that_fails_is_let_go_of_and_says_why():
    class Broken(Hand):
        def read(self):
            raise OSError("the cable is out")

    with ForceLoop() as loop:
        hand = Broken("hand")
        loop.attach(hand)
        assert until(lambda: loop.fault)
        assert loop.fault == "hand: the cable is out"
        assert hand.closed == 1
        loop.attach(Hand("another"))  # the needle is free again


def test_a_device_may_stand_turned_in_the_world():
    """What is x for the device is z in the world; a force comes back in its own axes."""
    turned = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 3], [0, 0, 0, 1.0]])
    with ForceLoop() as loop:
        hand = Hand(at=(-5.0, 0.0, 0.0))  # z = 8 in the world
        loop.publish(shaft())
        loop.attach(hand, device_to_reference=turned)
        assert until(lambda: loop.reading.needle_mm > 5)
        kept_fresh(loop, shaft(tip_mm=(0, 1, 0)), 0.05)
        with pytest.raises(ValueError, match="device_to_reference is not rigid"):
            loop.attach(hand, device_to_reference=2 * np.eye(4))


def test_ticks_are_as_many_as_a_millisecond_asks_for():
    """By counting, not by the clock of one tick: those computed and those left out are all there are."""
    with ForceLoop(Coupling(period_ms=0.5)) as loop:
        loop.forget_timing()
        began = time.monotonic()
        time.sleep(1.0)
        timing, passed = loop.timing, time.monotonic() - began
    assert timing.ticks + timing.skipped == pytest.approx(passed / 0.0005, rel=0.3)


def test_a_loop_needs_contacts_and_places():
    loop = ForceLoop()
    with pytest.raises(ValueError, match="is not a FrozenContact"):
        loop.publish("contact")
    with pytest.raises(ValueError, match=r"position_mm = \(1, 2\) has shape"):
        loop.move_to((1, 2))
    assert repr(loop) == "ForceLoop(stopped, no device, 1000 Hz)"


def test_loops_end_with_their_objects():
    threads = tasks()
    for _ in range(5):
        loop = ForceLoop()
        loop.start()
        loop.publish(shaft())
        del loop
    gc.collect()
    assert tasks() <= threads


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_the_child_of_a_fork_has_a_loop_that_is_stopped_and_may_begin():
    with ForceLoop() as loop:
        kept_fresh(loop, shaft(), 0.02)
        for _ in range(5):
            child = os.fork()
            if child == 0:
                code = 1
                try:
                    stopped = not loop._loop.running()
                    loop.start()
                    began = loop._loop.running()
                    loop.close()
                    code = 0 if stopped and began else 2
                finally:
                    os._exit(code)
            assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert loop._loop.running()


def test_without_the_core_there_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(_core, "active", _core.twin)
    with pytest.raises(ImportError, match="needs the compiled core; install"):
        ForceLoop()


def test_a_stiffness_that_is_not_stable_is_refused():
    with pytest.raises(ValueError, match=r"stiffness_n_mm = 2 is not stable with a delay of 5 ms; give at most 0\.615"):
        Coupling(stiffness_n_mm=2.0)
    assert Coupling(stiffness_n_mm=Coupling().stiffest_n_mm)
    with pytest.raises(ValueError, match=r"period_ms = 2 is out of range; give 0\.05 to 1 ms"):
        Coupling(period_ms=2.0)


def test_a_contact_is_a_value():
    assert shaft() == shaft()
    assert hash(shaft()) == hash(shaft())
    assert shaft() != shaft(friction=0.04)
    assert repr(shaft()) == "FrozenContact(12 points, tip at (0, 0, 0), 0 N along (0, 0, 1))"


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("compliance_mm_n", -np.eye(12), r"compliance_mm_n has -1 in its diagonal; tissue gives way"),
        ("compliance_mm_n", np.tri(12) + np.eye(12), "compliance_mm_n is not symmetric"),
        ("compliance_mm_n", np.eye(11), r"compliance_mm_n has shape \(11, 11\); give 12 x 12"),
        ("forces_n", np.full(12, np.nan), "forces_n contains NaN"),
        ("low_n", np.ones(12), "low_n = 1 holds on to no force of zero"),
        ("high_n", -np.ones(12), "high_n = -1 holds on to no force of zero"),
        ("axis", (0, 0, 0), "axis = .* has no direction"),
        ("tip", 12, "tip = 12 is too large; give at most 11"),
        ("lateral_n_mm", -1, "lateral_n_mm = -1 is out of range"),
    ],
)
def test_what_is_no_contact_is_refused_in_a_line(name, value, match):
    contact = shaft()
    fields = {field: getattr(contact, field) for field in contact.__dataclass_fields__}
    with pytest.raises(ValueError, match=match):
        FrozenContact(**fields | {name: value})
