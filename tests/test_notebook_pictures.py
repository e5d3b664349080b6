"""In a notebook, what has a picture shows it."""

import pickle
from io import BytesIO

import numpy as np
import pytest

import sonospline as ss


def test_a_notebook_shows_pictures():
    phantom, probe = ss.Phantom.uniform("liver", size_mm=(60, 20, 60)), ss.Probe.linear(depth_mm=30, lines=64)
    image = ss.Scanner(phantom, probe, ss.facing((30, 10, 1), depth=(0, 0.1, 1), right=(1, 0, 0))).render()
    shown = image._repr_png_()
    assert shown == image.frame._repr_png_()
    pillow = pytest.importorskip("PIL.Image", reason="needs the extra 'plot'")
    assert np.array_equal(np.asarray(pillow.open(BytesIO(shown))), image.pixels)
    assert pickle.loads(pickle.dumps(image.frame))._repr_png_() == shown
