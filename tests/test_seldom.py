"""Lines of a log of which one a minute is enough."""

import logging

from sonospline import _seldom


def test_one_line_a_minute_and_how_many_were_left_out(monkeypatch, caplog):
    now = [1000.0]
    monkeypatch.setattr(_seldom.time, "monotonic", lambda: now[0])
    log = _seldom.Seldom(logging.getLogger("seldom"))
    for number in range(200):
        log.say(f"line {number}")
        now[0] += 1
    assert caplog.messages == ["line 0", *(f"line {n} (59 more since the last such line)" for n in (60, 120, 180))]
    assert log.left_out == 19
