"""A needle that bends: its shape, and its image along it."""

import numpy as np
import pytest

from needle_images import PROBE, at_angle, scanner
from sonospline.geometry import BentNeedle
from sonospline.ultrasound import Artefacts, NeedleEcho


def bow(height_mm, half_mm=9.0, across_mm=0.0, points=61):
    """Bent from end to end about the middle of the image, 20 mm deep there; its plane may lean out of the image."""
    straight = at_angle(0, half_length=half_mm)
    share = np.linspace(0, 1, points)
    sag = (4 * share * (1 - share))[:, None]
    pose = scanner().probe_to_reference
    return BentNeedle(straight.at(share) + sag * (height_mm * pose[:3, 1] + across_mm * pose[:3, 2]))


def ridge(image, lines):
    """Range of the largest echo on each line, mm, and how large it is; below the haze under the face."""
    first = int(10 / PROBE.sample_mm)
    envelope = np.abs(image.iq[lines, first:])
    return (first + envelope.argmax(axis=1)) * PROBE.sample_mm, envelope.max(axis=1)


@pytest.mark.parametrize("artefacts", [Artefacts.none(), Artefacts()], ids=["clean", "every part on"])
def test_its_echo_lies_along_the_curve(artefacts):
    seen = scanner(needle=NeedleEcho.trocar(), artefacts=artefacts)
    lines = np.arange(58, 102, 2)
    deep, echo = ridge(seen.render(needle=bow(3.0)), lines)
    r, line, _ = PROBE.beam_coordinates(seen.plane.project(bow(3.0).points)).T
    on_the_curve = np.interp(lines, line[np.argsort(line)], r[np.argsort(line)])
    loud = echo > 0.1 * echo.max()  # a real shaft has drop-outs
    assert loud.mean() > 0.6
    assert deep[loud] == pytest.approx(on_the_curve[loud], abs=0.4)
    assert on_the_curve[loud].max() == pytest.approx(23.0, abs=0.2)  # a straight one would lie at 20 mm


def test_its_shadow_begins_at_the_curve_and_its_bright_part_is_where_it_is_square_to_the_beam():
    steel = scanner(needle=NeedleEcho.steel_2mm())
    echoes, shadow = steel._seen((bow(3.0),), steel.optics, steel.probe_to_reference)
    r, line, _ = PROBE.beam_coordinates(steel.plane.project(bow(3.0).points)).T
    inside = np.arange(int(line.min()) + 3, int(line.max()) - 2)
    begins = np.interp(inside, line[np.argsort(line)], r[np.argsort(line)]) + steel.needle_echo.diameter_mm
    assert shadow[0][inside] == pytest.approx(begins, abs=0.2)
    shaft = echoes[:-1]  # the last is the tip
    away = np.abs(shaft[:, 0] - np.median(line))
    assert shaft[away < 5, 2].max() > 2 * shaft[away > 20, 2].max()


def test_what_bends_out_of_the_slice_is_not_seen():
    seen = scanner(needle=NeedleEcho.trocar())
    image = seen.render(needle=bow(0.0, across_mm=6.0))
    assert np.array_equal(image.iq[75:85], seen.render().iq[75:85])
    assert np.abs(image.iq[40:120]).max() > 10 * np.abs(seen.render().iq[40:120]).max()


def test_a_straight_one_looks_like_a_rigid_one():
    seen = scanner(needle=NeedleEcho.trocar(), artefacts=Artefacts())
    rigid = at_angle(20, half_length=8.0)
    one, other = (seen.render(needle=needle).iq for needle in (rigid, BentNeedle(rigid.points)))
    assert np.abs(one - other).max() < 1e-4 * np.abs(one).max()


@pytest.mark.parametrize(
    "points, said",
    [
        ([(0, 0, 0)], r"points has shape \(1, 3\); give an \(m, 3\) array of at least two points"),
        ((1, 2, 3), "at least two points"),
        ([(0, 0, 0), (0, np.nan, 1)], "points"),
        ([(0, 0, 0), (1, 2, 3), (1, 2, 3)], r"points\[1\] and the next are both \(1, 2, 3\); leave one out"),
    ],
)
def test_shapes_that_cannot_be(points, said):
    with pytest.raises(ValueError, match=said):
        BentNeedle(points)
