"""Whether a picture should wait for the next command: only where one is about to come."""

import numpy as np
import pytest

from sonospline.simulator.arrival_clock import ArrivalClock


def after(beats):
    clock = ArrivalClock()
    for beat in beats:
        clock.beat(beat)
    return clock


@pytest.mark.parametrize("interval", [0.008, 1 / 60, 1 / 30])
def test_a_steady_stream_is_waited_for_when_its_next_command_is_near(interval):
    beats = interval * np.arange(20)
    clock = after(beats)
    due = beats[-1] + interval
    for now in np.linspace(beats[-1], due, 50):
        until = clock.worth_waiting_until(now)
        if due - now > 0.0101:
            assert until is None
        elif due - now < 0.0099:
            assert until == pytest.approx(due, abs=0.002)
            assert until >= due


def test_a_command_that_does_not_come_is_not_waited_for():
    clock = after(np.arange(20) / 60)
    assert clock.worth_waiting_until(20 / 60 + 0.002) is None
    assert clock.worth_waiting_until(30.0) is None


@pytest.mark.parametrize(
    "beats",
    [[], [0.0], [0.0, 1 / 60], np.cumsum([0.02, 0.005, 0.03, 0.01, 0.035, 0.006]), np.arange(20) / 10],
    ids=["none", "one", "two", "uneven", "slow"],
)
def test_what_is_no_steady_stream_is_not_waited_for(beats):
    clock, last = after(beats), beats[-1] if len(beats) else 0.0
    assert all(clock.worth_waiting_until(last + t) is None for t in np.linspace(0, 0.2, 100))


def test_a_stream_that_quickens_is_followed():
    clock = after([*np.arange(10) / 30, *(9 / 30 + np.arange(1, 10) / 60)])
    last = 9 / 30 + 9 / 60
    assert clock.worth_waiting_until(last + 1 / 60 - 0.004) == pytest.approx(last + 1 / 60, abs=0.004)
