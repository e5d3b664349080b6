"""Rude clients do no harm; the benchmark of ten minutes is the same for longer."""

import logging
import random

import pytest

from link_poses import SMALL_BLOCK
from link_rudeness import fuzzed
from link_soak import leaks, soak
from sonospline import igtl
from sonospline.simulator import SceneFile, make_scene


def test_ten_thousand_headers_that_lie():
    """Each is read, waited for or refused in one line; nothing is kept beyond what came."""
    chance, read, refused = random.Random(5), 0, 0
    for _ in range(10_000):
        framer = igtl.Framer(1 << 16)
        data = fuzzed(chance)
        framer.feed(data)
        try:
            found = framer.next()
            if found is not None:
                igtl.decode_body(*found)
                read += 1
        except igtl.WireError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1
        assert len(framer._held) <= len(data)
    assert read > 100
    assert refused > 1000


@pytest.mark.slow
def test_rude_clients_leave_nothing_behind():
    logging.disable(logging.WARNING)
    try:
        found = soak(5.0, 500, make_scene(SceneFile.parse(SMALL_BLOCK)))
    finally:
        logging.disable(logging.NOTSET)
    assert leaks(found) == []
    assert found["images"] > 3
