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


def test_each_has_its_own_minute_and_not_all_are_remembered(caplog):
    log = _seldom.Seldom(logging.getLogger("seldom"))
    for number in range(3):
        for host in ("a", "b"):
            log.say(f"{host} {number}", about=host, error=ValueError("seen") if host == "b" else None)
    assert caplog.messages == ["a 0", "b 0"] and log.left_out == 4
    assert [record.exc_info is not None for record in caplog.records] == [False, True]
    for number in range(1000):
        log.say("one of many", about=str(number))
    assert len(log._last) == 256
