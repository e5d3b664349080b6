"""Value objects compare by value, hash alike, and are told in one short line."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from sonospline.geometry import ImagePlane, LabelMap, Volume, facing

numbers = st.floats(-1e3, 1e3, allow_subnormal=False)
points = st.tuples(numbers, numbers, numbers)
spacings = st.tuples(*[st.floats(1e-3, 1e3)] * 3)
shapes = st.tuples(*[st.integers(2, 6)] * 3)


def needles():
    return st.tuples(points, points).filter(lambda p: np.linalg.norm(np.subtract(*p)) > 1).map(lambda p: ss.Needle(*p))


def grids():
    return st.builds(lambda n, h, o: ss.Grid(shape=n, spacing=h, origin=o), shapes, spacings, points)


def tissues():
    return st.builds(ss.Tissue, grids(), st.sampled_from(ss.FACES))


def planes():
    return st.builds(
        lambda at, shape, h: ImagePlane(
            image_to_reference=facing(at, depth=(0, 0.3, 1), right=(1, 0, 0)), shape=shape, spacing_mm=h
        ),
        points,
        st.tuples(st.integers(1, 500), st.integers(1, 500)),
        st.floats(0.01, 2),
    )


def label_maps():
    return st.builds(
        lambda n, h, seed: LabelMap(
            voxels=np.random.default_rng(seed).integers(0, 4, n).astype(np.uint8), spacing=h, names={1: "liver"}
        ),
        shapes,
        spacings,
        st.integers(0, 5),
    )


@pytest.mark.parametrize("make", [needles, grids, tissues, planes, label_maps], ids=lambda make: make.__name__)
def test_what_is_made_alike_is_equal_and_hashes_alike(make):
    @settings(max_examples=50, deadline=None)
    @given(make(), make())
    def check(one, other):
        again = pickle.loads(pickle.dumps(one))
        assert one == again
        assert hash(one) == hash(again)
        assert {one: 1}[again] == 1
        assert one != "something else"
        if one == other:
            assert hash(one) == hash(other)

    check()


@settings(max_examples=50, deadline=None)
@given(needles(), points)
def test_another_tip_is_another_needle(needle, tip):
    if np.linalg.norm(np.subtract(tip, needle.entry)) > 1:
        assert (ss.Needle(needle.entry, tip) == needle) == bool((np.asarray(tip) == needle.tip).all())


def test_equal_numbers_are_the_same_whatever_their_type_and_sign_of_zero():
    assert ss.Needle((0, 0.5, 1), (1, 0.5, 1)) == ss.Needle((-0.0, 0.5, 1.0), np.array([1.0, 0.5, 1.0]))
    assert hash(ss.Needle((0, 0.5, 1), (1, 0.5, 1))) == hash(ss.Needle((-0.0, 0.5, 1), (1, 0.5, 1)))
    whole, real = (Volume(voxels=np.ones((2, 2, 2), kind), spacing=[1, 1, 1]) for kind in (int, float))
    assert whole == real
    assert hash(whole) == hash(real)


def test_unknown_voxels_are_equal_to_themselves():
    voxels = np.full((2, 2, 2), np.nan)
    assert Volume(voxels=voxels, spacing=(1, 1, 1)) == Volume(voxels=voxels.copy(), spacing=(1, 1, 1))
    assert Volume(voxels=voxels, spacing=(1, 1, 1)) != Volume(voxels=np.zeros((2, 2, 2)), spacing=(1, 1, 1))
    volume = Volume(voxels=np.zeros((2, 2, 2), np.uint8), spacing=(1, 1, 1))
    assert volume != LabelMap(voxels=volume.voxels, spacing=(1, 1, 1))
