"""The runner: one thread that steps at a rate, and subscribers of whom none can hold it up."""

import threading
import time

import pytest
from msgspec.structs import replace

from simulator_scenes import SMALL
from sonospline.simulator import Console, Runner, SceneFile, Session, make_scene, subscription


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


@pytest.fixture
def console(scene):
    return Console(Session(scene, model="paper"))


class Taker:
    """A subscriber that keeps what it is given, and says when it was."""

    def __init__(self, takes_s=0.0):
        self.frames, self.stamps, self.errors, self.takes_s = [], [], [], takes_s

    def __call__(self, frame, stamp):
        if self.takes_s:
            time.sleep(self.takes_s)
        self.frames.append(frame)
        self.stamps.append(stamp)

    @property
    def numbers(self):
        return [frame.number for frame in self.frames]


def at_depth(console, depth):
    return console.scene.start.with_needle(depth=depth)


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.002)
    return condition()


def shown(taker, depth):
    return wait_for(lambda: taker.frames and taker.frames[-1].command.needle.depth == depth)


def push(runner, taker, steps=60, first=1):
    """Push millimetre by millimetre, a frame each."""
    for seq in range(first, first + steps):
        runner.submit(at_depth(runner.console, float(seq)), seq)
        assert wait_for(lambda seq=seq: taker.stamps and taker.stamps[-1].seq >= seq)


def test_the_newest_command_wins_and_actions_keep_their_place(console):
    """Commands given while a frame is made are forgotten but for the last; an undo is not overtaken."""
    frames, gate = [], threading.Event()

    def hold(frame, stamp):
        frames.append((stamp.seq, frame.command.needle.depth))
        if stamp.seq == 1:
            gate.wait(60)

    with Runner(console) as runner:
        runner.subscribe(hold, quick=True)  # in the console's own thread
        runner.submit(at_depth(console, 1.0), 1)
        assert wait_for(lambda: frames and frames[-1][0] == 1)
        for seq in range(2, 30):
            runner.submit(at_depth(console, float(seq)), seq)
        runner.do(Console.undo_pass)
        runner.submit(at_depth(console, 7.0), 30)
        gate.set()
        assert wait_for(lambda: any(seq == 30 for seq, _ in frames))
    seen = [seq for seq, _ in frames]
    assert seen == sorted(seen)
    assert {1, 29, 30} <= set(seen) <= {0, 1, 29, 30}
    assert dict(frames)[30] == 7.0
    assert console.last.metrics.passes == 1  # the first pass was undone


def test_everybody_is_given_the_same_frames(console):
    takers = [Taker() for _ in range(3)]
    with Runner(console) as runner:
        subscriptions = [runner.subscribe(t, capacity=1000, when_full="refuse") for t in takers]
        push(runner, takers[0], steps=20)
    for taker in takers:  # who came later was given none of before
        assert len(taker.frames) >= 20
        assert taker.frames == takers[0].frames[-len(taker.frames) :]
    assert [s.given for s in subscriptions] == [len(t.frames) for t in takers]
    assert [s.dropped for s in subscriptions] == [0] * 3


def test_a_blocked_subscriber_delays_nobody(console):
    for_ever, taker = threading.Event(), Taker()
    runner = Runner(console)
    blocked = runner.subscribe(lambda frame, stamp: for_ever.wait())
    runner.subscribe(taker, quick=True)
    push(runner, taker)
    assert (blocked.given, len(taker.frames) >= 60) == (0, True)
    assert blocked.dropped >= 58  # one is in its hands, one waits
    began = time.monotonic()
    runner.close()
    assert time.monotonic() - began < 10
    for_ever.set()
    blocked.join(60)
    assert blocked.given == 1  # what waited when it was closed is not handed on


def test_one_that_is_blocked_and_alone_does_not_hold_up_the_session(console):
    for_ever = threading.Event()
    with Runner(console) as runner:
        runner.subscribe(lambda frame, stamp: for_ever.wait())
        for depth in (10.0, 20.0):
            runner.submit(at_depth(console, depth), int(depth))
            assert wait_for(lambda depth=depth: console.command.needle.depth == depth)
        for_ever.set()


def test_one_that_raises_at_every_frame_hurts_nobody_and_is_told(console, caplog):
    taker, errors, raised = Taker(), [], []

    def fail(frame, stamp):
        raised.append(frame.number)
        raise RuntimeError("no ink")

    with Runner(console) as runner:
        failing = runner.subscribe(fail, on_error=errors.append)
        quick = runner.subscribe(fail, quick=True)
        runner.subscribe(taker, on_error=taker.errors.append)
        push(runner, taker)
    assert len(raised) > 60
    assert (failing.given, quick.given) == (0, 0)
    assert set(errors) == {"no ink"}
    assert len(errors) <= 60  # not at every frame
    assert taker.errors == []
    assert "a subscriber failed: no ink" in caplog.text


def test_one_that_raises_at_errors_too_still_gets_every_frame(console, caplog):
    recorder, gate = Taker(), threading.Event()

    def record(frame, stamp):
        gate.wait(60)
        recorder(frame, stamp)

    with Runner(console) as runner:
        recording = runner.subscribe(record, on_error=lambda line: 1 / 0, capacity=2, when_full="refuse")
        runner.subscribe(taker := Taker(), quick=True)
        push(runner, taker, steps=10)
        gate.set()
        push(runner, taker, steps=3, first=11)
        assert wait_for(lambda: len(recorder.frames) > 3)
    assert recording.given == len(recorder.frames)
    assert recording.given + recording.dropped == console.last.number + 1 - recorder.numbers[0]
    assert "a subscriber failed at an error: division by zero" in caplog.text


def test_one_that_cannot_say_whether_it_is_ready_gets_nothing_and_is_told(console):
    taker, broken, errors = Taker(), Taker(), []
    with Runner(console) as runner:
        runner.subscribe(broken, ready=lambda: 1 / 0, on_error=errors.append)
        runner.subscribe(taker)
        push(runner, taker, steps=5)
        assert wait_for(lambda: errors)
    assert broken.frames == []
    assert set(errors) == {"division by zero"}


def test_one_ten_times_too_slow_gets_the_newest_frames(console):
    taker, slow = Taker(), Taker(takes_s=10 / 90)
    with Runner(console) as runner:
        late = runner.subscribe(slow)
        runner.subscribe(taker, quick=True)
        push(runner, taker)
        assert wait_for(lambda: slow.stamps and slow.stamps[-1].seq == 60)  # the last one reaches it
    assert slow.numbers == sorted(set(slow.numbers))
    assert late.dropped > 0
    assert late.given + late.dropped <= console.last.number + 1


def test_a_quick_one_that_is_slow_gets_a_thread_of_its_own(console, caplog):
    taker, threads = Taker(), []

    def slow(frame, stamp):
        threads.append(threading.current_thread().name)
        time.sleep(1.5 * subscription.SLOW_S)

    with Runner(console) as runner:
        runner.subscribe(taker)
        runner.subscribe(slow, quick=True)
        push(runner, taker, steps=20)
        assert wait_for(lambda: len(threads) > 4)
    assert threads[:3] == ["sonospline-session"] * 3
    assert set(threads[3:]) == {"sonospline-subscriber"}
    assert "gets its own thread" in caplog.text


def test_a_recorder_gets_every_frame_in_order(console):
    taker, recorder = Taker(), Taker(takes_s=0.03)
    with Runner(console) as runner:
        recording = runner.subscribe(recorder, on_error=recorder.errors.append, capacity=1000, when_full="refuse")
        runner.subscribe(taker, quick=True)
        push(runner, taker, steps=30)
        recording.close()
        recording.join(60)  # those that wait are still handed on
    assert recorder.numbers == list(range(len(recorder.frames)))
    assert len(recorder.frames) >= 30
    assert (recording.dropped, recorder.errors) == (0, [])


def test_a_recorder_that_loses_frames_is_told_how_many_and_where(console):
    taker, gate, notes = Taker(), threading.Event(), []

    def record(frame, stamp):
        notes.append(frame.number)
        gate.wait(60)

    with Runner(console) as runner:
        recording = runner.subscribe(record, on_error=notes.append, capacity=4, when_full="refuse")
        runner.subscribe(taker, quick=True)
        push(runner, taker, steps=30)
        lost = recording.dropped
        gate.set()
        push(runner, taker, steps=3, first=31)
        assert wait_for(lambda: len(notes) > 6)
    assert notes[:5] == list(range(notes[0], notes[0] + 5))
    assert lost >= 24
    number = notes[6]
    after = notes[4] + 1
    assert (
        notes[5] == f"{number - after} frames were lost before frame {number}; take them faster, or give more than "
        "capacity = 4"
    )
    assert recording.given + recording.dropped == console.last.number + 1 - notes[0]


def test_frames_wait_until_their_subscriber_is_ready(console):
    """A page that draws by credit gets the newest frame at once when it is ready, and holds up nobody else."""
    page, taker, credit = Taker(), Taker(), threading.Event()
    with Runner(console) as runner:
        frames = runner.subscribe(page, ready=credit.is_set, quick=True)
        runner.subscribe(taker)
        push(runner, taker, steps=20)
        assert page.frames == []
        credit.set()
        frames.wake()
        assert wait_for(lambda: page.frames)
    assert page.stamps[0].seq == 20


def test_where_nobody_is_ready_nothing_is_stepped(console):
    taker, credit = Taker(), threading.Event()
    with Runner(console) as runner:
        frames = runner.subscribe(taker, ready=credit.is_set)
        runner.submit(at_depth(console, 10.0), 1)
        runner.submit(at_depth(console, 20.0), 2)
        assert not wait_for(lambda: console.last is not None, 0.2)
        credit.set()
        frames.wake()
        assert shown(taker, 20.0)
    assert taker.stamps[0].seq == 2


def test_who_unsubscribes_gets_nothing_more(console):
    taker, other = Taker(), Taker()
    with Runner(console) as runner:
        leaving = runner.subscribe(other)
        runner.subscribe(taker)
        push(runner, taker, steps=5)
        leaving.close()
        leaving.join(60)
        count = len(other.frames)
        push(runner, taker, steps=5, first=6)
        assert len(other.frames) == count
    late = runner.subscribe(other)  # the runner has ended
    assert late.closed


def test_a_step_that_fails_leaves_the_last_frame_and_is_told_to_all(console, monkeypatch, caplog):
    takers = [Taker(), Taker()]
    with Runner(console) as runner:
        for taker, quick in zip(takers, (True, False), strict=True):
            runner.subscribe(taker, on_error=taker.errors.append, quick=quick)
        runner.submit(at_depth(console, 20.0), 1)
        assert shown(takers[1], 20.0)
        good = console.last
        with monkeypatch.context() as broken:
            broken.setattr(next(iter(console.session._models.values())), "step", lambda *poses: 1 / 0)
            runner.submit(at_depth(console, 30.0), 2)
            assert wait_for(lambda: all(taker.errors for taker in takers))
        assert console.command.needle.depth == 20
        assert console.last.field is good.field
        runner.submit(at_depth(console, 30.0), 3)
        assert wait_for(lambda: console.command.needle.depth == 30)
    assert [taker.errors for taker in takers] == [["division by zero"]] * 2
    assert "the last frame stays" in caplog.text


def test_a_frozen_session_sends_nothing(console):
    taker = Taker()
    with Runner(console) as runner:
        runner.subscribe(taker)
        runner.submit(at_depth(console, 20.0), 1)
        assert shown(taker, 20.0)
        runner.submit(replace(console.command, frozen=True), 2)
        assert wait_for(lambda: taker.frames[-1].command.frozen)
        count = len(taker.frames)
        assert not wait_for(lambda: len(taker.frames) > count, 0.4)
        runner.submit(replace(console.command, frozen=False), 3)
        assert wait_for(lambda: len(taker.frames) > count + 2)  # noise lives again


def test_elastic_tissue_comes_to_rest_by_itself(scene):
    taker, console = Taker(), Console(Session(scene))
    with Runner(console) as runner:
        runner.subscribe(taker)
        runner.submit(at_depth(console, 45.0), 1)
        assert wait_for(lambda: taker.frames and taker.frames[-1].settled and shown(taker, 45.0))
    assert taker.frames[-1].readouts.estimate <= 1.5e-3  # of the iteration and of the load's place


def test_no_thread_is_left(console):
    before = set(threading.enumerate())
    with Runner(console) as runner:
        runner.subscribe(lambda frame, stamp: None, quick=True)
        runner.subscribe(lambda frame, stamp: None)
        runner.submit(at_depth(console, 5.0), 1)
        assert len(threading.enumerate()) == len(before) + 2
    assert set(threading.enumerate()) == before


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"capacity": 0}, "capacity = 0 is too small; give at least 1"),
        ({"when_full": "wait"}, "when_full = 'wait' is not known; choose one of latest, refuse"),
    ],
)
def test_what_makes_no_sense_is_refused(console, options, says):
    with Runner(console) as runner, pytest.raises(ValueError, match=says):
        runner.subscribe(print, **options)
