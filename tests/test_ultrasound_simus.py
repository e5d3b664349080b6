"""Ours against SIMUS: the same points before the same arrays, one after the other and in clouds."""

import numpy as np
import pytest
from scipy import stats

import simus_peer as peer

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", peer.ARRAYS)
def test_a_point_spreads_as_far(name):
    parameters, probe = peer.array(name, *peer.ARRAYS[name])
    for depth in peer.DEPTHS[name]:
        found = peer.point_spread(parameters, probe, depth)
        for theirs, mine in (found.axial, found.lateral):
            assert mine == pytest.approx(theirs, rel=0.15)


@pytest.mark.parametrize("name", peer.ARRAYS)
def test_a_cloud_has_the_same_speckle(name):
    """Not only its statistics: bright and dark lie at the same places."""
    parameters, probe = peer.array(name, *peer.ARRAYS[name])
    theirs, mine = peer.speckle(parameters, probe, *peer.CLOUDS[name])
    assert np.corrcoef(theirs.ravel(), mine.ravel())[0, 1] > 0.8
    ratios = [envelope.mean() / envelope.std() for envelope in (theirs, mine)]
    assert ratios[1] == pytest.approx(ratios[0], rel=0.04)
    assert ratios == pytest.approx([1.913, 1.913], rel=0.1)
    along = int(np.ceil(2 * peer.FWHM * probe.axial_sigma / probe.sample_mm))
    apart = [(e / np.sqrt(np.mean(e**2)))[::2, ::along].ravel() for e in (theirs, mine)]
    assert len(apart[0]) > 100
    assert stats.ks_2samp(*apart).pvalue > 0.05
