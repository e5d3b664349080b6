"""Colour Doppler: blood that flows as it should, and velocities as theory has them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonospline.fields import GridField
from sonospline.geometry import Grid, facing
from sonospline.geometry.volume import Volume
from sonospline.phantoms import kidney_phantom
from sonospline.ultrasound import Doppler, Flow, Phantom, Probe, Scanner
from sonospline.ultrasound.acoustics import NO_ECHO
from sonospline.ultrasound.colour_flow import NO_FLOW, autocorrelation, colours, without_polynomial
from sonospline.ultrasound.optics import Optics

POSE = facing((15, 6, 0), depth=(0, 0, 1), right=(1, 0, 0))
PROBE = Probe.linear(frequency_mhz=5, depth_mm=28, aperture_mm=28, lines=64, samples=512, elevation_focus_mm=14)
BOX = (-6.0, 6.0, 8.0, 21.0)


def vessel(slope=0.0, speed=30.0, radius=3.0, flows=True):
    """A tube across liver, its axis through the middle of the box."""
    low, high = 14.0 - 15 * slope, 14.0 + 15 * slope
    flow = Flow(start=(0, 6, low), end=(30, 6, high), radii_mm=(radius, radius), speed_cm_s=speed)
    x, y, z = np.meshgrid(np.arange(61) / 2, np.arange(25) / 2, np.arange(57) / 2, indexing="ij")
    apart = np.hypot(y - 6, (z - 14 - slope * (x - 15)) / np.hypot(1, slope))
    labels = Volume(voxels=(apart < radius).astype(np.uint8), spacing=(0.5,) * 3)
    return Phantom(labels, {0: "liver", 1: "blood"}, flows=[flow] if flows else [])


def velocities(frame, slope=0.0, within=1.0, radius=3.0):
    """Velocities shown within so much of the lumen's radius."""
    colour, plane = frame.colour, frame.plane
    rows, columns = colour.levels.shape
    x = plane.corner_mm[0] + plane.spacing_mm[0] * (colour.corner[1] + np.arange(columns))
    z = plane.corner_mm[1] + plane.spacing_mm[1] * (colour.corner[0] + np.arange(rows))[:, None]
    apart = np.abs(z - 14 - slope * x) / np.hypot(1, slope)
    return colour.velocity_cm_s[(apart < within * radius) & (abs(x) < 3)]


# --- blood ---


@given(st.floats(1, 6), st.floats(1, 6), st.floats(0.1, 90), st.floats(0, 1e4))
@settings(max_examples=10, deadline=None)
def test_blood_stays_in_its_vessel_and_is_as_fast_as_its_streamline(first, last, speed, time_s):
    flow = Flow(start=(3, -2, 5), end=(20, 9, 40), radii_mm=(first, last), speed_cm_s=speed)
    blood = flow.blood(0.5, seed=4)
    step = 1e-6
    now, later = blood.places(time_s), blood.places(time_s + step)
    away = now - flow.start
    along = away @ flow.axes[0]
    apart = np.linalg.norm(away - along[:, None] * flow.axes[0], axis=1) / (first + flow.taper * along)
    assert apart.max() < 1 + 1e-9 and along.min() > -1e-9 and along.max() < flow.length_mm + 1e-9
    moved = (later - now) @ flow.axes[0]
    wanted = np.array([flow.speed_at(at) @ flow.axes[0] for at in now])
    stays = moved > -1e-3  # what leaves comes in again
    assert np.allclose(moved[stays] / step / 10, wanted[stays], rtol=2e-2, atol=0.05 + 1e-7 * time_s)


def test_a_taper_carries_the_same_volume_all_along():
    flow = Flow(start=(0, 0, 0), end=(50, 0, 0), radii_mm=(4, 2), speed_cm_s=20)
    blood = flow.blood(50, seed=0)
    counts = [np.histogram(blood.places(t)[:, 0], bins=10, range=(0, 50))[0] for t in (0.0, 0.7)]
    lumen = np.diff([flow.passed(at) for at in np.linspace(0, 50, 11)])
    for count in counts:
        assert np.allclose(count / count.sum(), lumen / lumen.sum(), rtol=0.06)
    assert np.allclose(flow.speed_at((50, 0, 0)), (80, 0, 0))


def test_slow_pulses_leave_no_blood_out_but_what_comes_in_again():
    flow = Flow(start=(0, 0, 20), end=(30, 0, 20), radii_mm=(3, 3), speed_cm_s=100)
    blood = flow.blood(20.0, 3)
    first, last = (blood.places(time_s) for time_s in (1.0, 1.0 + 9 / 500))
    stays = blood.rounds(1.0) == blood.rounds(1.0 + 9 / 500)
    assert (last[stays, 0] >= first[stays, 0]).all()
    assert (last[~stays, 0] < first[~stays, 0]).all()
    assert (last - first)[stays, 0].max() == pytest.approx(flow.fastest_mm_s * 9 / 500, rel=0.02)
    assert 0.2 < (~stays).mean() < 0.4  # as far as the mean goes, 9 of 30 mm


def test_between_is_those_between():
    blood = Flow(start=(0, 0, 0), end=(50, 0, 0), radii_mm=(4, 2), speed_cm_s=20).blood(2, seed=0)
    x = blood.places(0.3)[:, 0]
    assert set(blood.between(0.3, 10, 20)) == set(np.flatnonzero((x >= 10) & (x <= 20)))


# --- velocities ---


@pytest.mark.parametrize("slope, steer, speed", [(0.0, 20, 30), (0.15, -15, 30), (0.0, -25, 55), (0.5, 0, 12)])
def test_the_mean_velocity_is_the_true_one(slope, steer, speed):
    along = -speed * np.sin(np.radians(steer) + np.arctan(slope))  # of the fastest; away from the probe is minus
    doppler = Doppler(box_mm=(-4, 4, 9, 19), prf_hz=1.4 * abs(along) * PROBE.frequency_mhz / 0.0385, steer_deg=steer)
    frame = Scanner(vessel(slope, speed), PROBE, POSE, doppler=doppler).render().frame
    mean = np.nanmean(velocities(frame, slope))
    assert mean == pytest.approx(2 / 3 * along, rel=0.1)  # a parabola's, along the diameter


@pytest.mark.parametrize("share, aliases", [(1.3, False), (0.8, True)])
def test_it_aliases_where_theory_says(share, aliases):
    """Where v cos > PRF c / (4 f0) the middle of the vessel is shown as coming from the other side."""
    speed, steer = 50.0, 25
    along = -speed * np.sin(np.radians(steer))
    doppler = Doppler(box_mm=(-4, 4, 9, 19), prf_hz=share * abs(along) * PROBE.frequency_mhz / 0.0385, steer_deg=steer)
    limit = doppler.nyquist_cm_s(PROBE)
    frame = Scanner(vessel(speed=speed), PROBE, POSE, doppler=doppler).render().frame
    fastest = np.nanmedian(velocities(frame, within=0.12))
    assert limit == pytest.approx(share * abs(along))
    assert fastest == pytest.approx(along + 2 * limit * aliases, abs=0.1 * abs(along))
    shown = velocities(frame)
    assert np.nanmax(np.abs(shown)) <= limit * 1.001
    beside = velocities(frame, within=0.7)  # a parabola crosses the limit where 1 - r^2 = share
    share_beyond = np.mean(beside[np.isfinite(beside)] > 0)
    assert share_beyond == pytest.approx(np.sqrt(1 - share) / 0.7 if aliases else 0, abs=0.12)


def test_the_wall_filter_takes_tissue_and_leaves_what_turns():
    optics = Optics(PROBE)
    k = np.arange(10)
    still = np.full((10, 4, 64), 1e4 + 2e3j) + (30 * k)[:, None, None]
    turning = np.exp(0.9j * k)[:, None, None] * np.ones((1, 4, 64))
    found = autocorrelation((still + turning).astype(np.complex64), without_polynomial(10, 1), optics)
    assert np.allclose(np.angle(found.lag_one), 0.9, atol=0.06)
    assert np.allclose(without_polynomial(10, 2) @ np.vander(k / 9, 3), 0, atol=1e-12)


def test_colours_say_towards_and_away():
    table = colours()
    assert table.shape == (256, 3) and table[255][0] == 255 and table[1][2] == 255
    assert (table[129:, 2] == 0).all() and (table[1:128, 0] == 0).all()


@pytest.mark.parametrize("ensemble", [4, 10])
def test_noise_is_another_in_every_pulse_however_large_the_box(ensemble):
    """Where nothing echoes, the wall filter leaves its share of it, and its phase turns anyhow."""
    few, box = Probe.linear(frequency_mhz=12, lines=32), Doppler(box_mm=(-19, 19, 0, 40), ensemble=ensemble)
    phantom = Phantom.uniform("gel", size_mm=(30, 12, 50))
    shown = [
        Scanner(phantom, few, POSE, doppler=replace(box, threshold_db=threshold)).render(frame=3).frame.colour
        for threshold in (-3.0, 3.0)
    ]
    assert [np.isfinite(colour.beams_cm_s).mean().round(1) for colour in shown] == [1.0, 0.0]
    assert np.nanstd(shown[0].beams_cm_s) > 0.3 * shown[0].nyquist_cm_s


# --- off, again, elsewhere ---


def test_off_not_a_bit_changes_and_on_blood_moves():
    moving, at_rest = vessel(), vessel(flows=False)
    plain = Scanner(at_rest, PROBE, POSE).render()
    assert np.array_equal(Scanner(moving, PROBE, POSE).render(time_s=3.0).iq, plain.iq)
    on = Scanner(moving, PROBE, POSE, doppler=Doppler(box_mm=BOX))
    first, again, later = on.render(), on.render(), on.render(time_s=0.05)
    assert np.array_equal(first.iq, again.iq)
    assert np.array_equal(first.frame.colour.beams_cm_s, again.frame.colour.beams_cm_s, equal_nan=True)
    row = first.beams.shape[1] // 2
    assert (first.beams[:, row] != later.beams[:, row]).mean() > 0.9  # in the vessel
    assert (first.beams[:, row // 3] != later.beams[:, row // 3]).mean() < 0.02  # in the liver
    assert np.array_equal(on.with_doppler(None).render().iq, plain.iq)


def test_of_two_vessels_the_one_with_flow_falls_silent():
    phantom = vessel(radius=1.5)
    voxels = phantom.bytes.copy()
    voxels[:, :, 48:52] = 1
    both = Phantom(Volume(voxels=voxels, spacing=(0.5,) * 3), phantom.tissues, flows=phantom.flows)
    named = [both.still.tissues[both.still.bytes[30, 12, z]] for z in (28, 50)]
    assert [(tissue.name, tissue.backscatter_db > NO_ECHO) for tissue in named] == [("blood", False), ("blood", True)]
    assert phantom.still.labels is phantom.labels  # all of it flows


def test_blood_flows_in_every_vessel_of_the_kidney():
    phantom = kidney_phantom(spacing_mm=1.0).phantom
    (blood,) = [label for label, tissue in phantom.tissues.items() if tissue.name == "blood"]
    flowing = phantom.labels.connected(blood, [flow.middle for flow in phantom.flows])
    assert len(phantom.flows) == 4 and np.array_equal(flowing, phantom.bytes == blood)


def test_a_moved_scanner_shows_what_a_new_one_shows():
    there = facing((16, 6, 0), depth=(0, 0, 1), right=(1, 0, 0))
    here = Scanner(vessel(), PROBE, POSE, doppler=Doppler(box_mm=BOX, steer_deg=15))
    here.render()
    moved, new = here.moved(there), Scanner(vessel(), PROBE, there, doppler=here.doppler)
    one, other = (scanner.render(time_s=0.2).frame.colour for scanner in (moved, new))
    assert np.array_equal(one.levels, other.levels) and one.nyquist_cm_s == other.nyquist_cm_s


def test_a_pressed_vessel_is_flat_and_still_flows():
    grid = Grid.covering((30, 12, 28), nodes=4000)
    squeeze = np.zeros((*grid.shape, 3), np.float32)
    squeeze[..., 2] = (0.3 * (14 - grid.points[:, 2])).reshape(grid.shape)  # towards the vessel's axis
    on = Scanner(vessel(), PROBE, POSE, doppler=Doppler(box_mm=BOX, prf_hz=5000, steer_deg=20))
    heights = [
        np.isfinite(on.render(field).frame.colour.beams_cm_s[8:-8]).sum() for field in (None, GridField(grid, squeeze))
    ]
    assert heights[1] / heights[0] == pytest.approx(0.7, abs=0.12)


def test_a_convex_face_has_its_box_along_its_arc():
    probe = Probe.curvilinear(frequency_mhz=5, depth_mm=28, aperture_mm=28, lines=64, samples=512, radius_mm=40)
    doppler = Doppler(box_mm=(-5, 5, 9, 20), prf_hz=1600)
    frame = Scanner(vessel(0.5, 20), probe, POSE, doppler=doppler).render().frame
    assert np.nanmean(velocities(frame, 0.5)) == pytest.approx(-20 * 2 / 3 * np.sin(np.arctan(0.5)), rel=0.12)
    assert np.ptp(frame.colour.outline_mm[:, 0]) > 10


def test_the_picture_has_the_colours_and_saves_them(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    image = Scanner(vessel(), PROBE, POSE, doppler=Doppler(box_mm=BOX, steer_deg=20)).render()
    rgb = image.frame.shown
    assert rgb.shape == (*image.pixels.shape, 3)
    assert ((rgb[..., 2] > rgb[..., 0]).sum()) == (image.frame.colour.levels < 0).sum() - (
        image.frame.colour.levels == NO_FLOW
    ).sum()
    image.save(tmp_path / "flow.png")
    assert np.array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "flow.png"))), rgb)
    assert image._repr_png_()[25] == 2  # RGB


# --- bad input ---


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"ensemble": 1}, "ensemble = 1"),
        ({"ensemble": 65}, "too many pulses"),
        ({"prf_hz": 0}, "prf_hz = 0"),
        ({"prf_hz": -5}, "prf_hz = -5"),
        ({"prf_hz": float("nan")}, "prf_hz"),
        ({"wall_filter": 9}, "leaves nothing of ensemble = 10"),
        ({"box_mm": (5, -5, 8, 20)}, "left < right"),
        ({"box_mm": (-5, 5, 20, 8)}, "top < bottom"),
        ({"box_mm": (-5, 5, 8)}, "give left, right, top, bottom"),
        ({"steer_deg": 45}, "too steep"),
    ],
)
def test_settings_that_cannot_be(changes, said):
    with pytest.raises(ValueError, match=said):
        Doppler(**({"box_mm": BOX} | changes))


@pytest.mark.parametrize(
    "probe, changes, said",
    [
        (PROBE, {"box_mm": (-20, 5, 8, 20)}, "reaches beyond the image, which is -14 to 14 mm wide"),
        (PROBE, {"box_mm": (-5, 5, 8, 40)}, "28 mm deep"),
        (PROBE, {"box_mm": (-13, 13, 8, 20), "steer_deg": 20}, "steered by 20 degrees, reaches beyond"),
        (PROBE, {"prf_hz": 90_000}, "give at most"),
        (Probe.curvilinear(), {"steer_deg": 10}, "convex face"),
        (Probe.phased(), {}, "phased probe"),
    ],
)
def test_boxes_that_a_probe_cannot_hear(probe, changes, said):
    with pytest.raises(ValueError, match=said):
        Scanner(vessel(), probe, POSE, doppler=replace(Doppler(box_mm=BOX), **changes))


@pytest.mark.parametrize(
    "flow, said",
    [
        ({"start": (0, 0, 0), "end": (0, 0, 0)}, "one point"),
        ({"radii_mm": (0, 1)}, r"radii_mm\[0\]"),
        ({"speed_cm_s": -1}, "speed_cm_s"),
    ],
)
def test_vessels_that_cannot_be(flow, said):
    with pytest.raises(ValueError, match=said):
        Flow(**({"start": (0, 6, 14), "end": (30, 6, 14), "radii_mm": (3, 3), "speed_cm_s": 10} | flow))


def test_a_flow_elsewhere_or_in_silent_urine_is_refused():
    away = Flow(start=(0, 6, 90), end=(30, 6, 90), radii_mm=(3, 3), speed_cm_s=10)
    with pytest.raises(ValueError, match="outside the labels"):
        Phantom(vessel().labels, {0: "liver", 1: "blood"}, flows=[away])
    with pytest.raises(ValueError, match="urine, which has no echo"):
        Phantom(vessel().labels, {0: "liver", 1: "urine"}, flows=vessel().flows)
