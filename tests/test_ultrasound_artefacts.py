"""What a real image shows beyond clean beams: surfaces from all sides, walls, clutter, haze, and their switches."""

from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from builds import INSTRUCTION_SETS, needs_core
from liver import CURVED, FLAT, LINEAR, a_field, liver_scanner
from sonospline import _core
from sonospline.geometry import facing
from sonospline.geometry.volume import Volume
from sonospline.ultrasound import AcousticTissue, Artefacts, Display, Phantom, Probe, Scanner, grating
from sonospline.ultrasound.aim import aim
from sonospline.ultrasound.optics import Optics

NONE = Artefacts.none()
SURFACES = replace(NONE, diffuse=True)
OIL = AcousticTissue(name="oil", speed_m_s=1400, density_kg_m3=900, attenuation_db_cm_mhz=0, backscatter_db=-200)
SMALL = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
QUIET = Display(noise_db=-150)


def halves(below):
    """Gel over something, which begins at z = 24, and nothing in either that echoes but their surface."""
    voxels = np.zeros((90, 30, 60), np.uint8)
    voxels[:, :, 24:] = 1
    return Phantom(
        Volume(voxels=voxels, spacing=(1, 1, 1)), {0: replace(OIL, name="lighter", density_kg_m3=850), 1: below}
    )


def surface_db(degrees, artefacts, field=None):
    """Level of the surface, seen so far from square, in the middle of the image; mean of power over 24 beams."""
    tilt = np.radians(degrees)
    depth = (np.sin(tilt), 0, np.cos(tilt))
    start = np.array([45, 15, 23.5]) - 22 * np.array(depth)
    pose = facing(start, depth=depth, right=(np.cos(tilt), 0, -np.sin(tilt)))
    image = Scanner(halves(OIL), SMALL, pose, display=QUIET, artefacts=artefacts, margin_mm=20).render(field)
    return 10 * np.log10(np.mean(np.square(image.envelope[20:44]).max(axis=1)))


def test_a_surface_is_seen_from_the_side_12_to_20_db_below_its_mirror():
    levels = [surface_db(degrees, SURFACES) for degrees in (0, 30, 60)]
    assert -20 < levels[1] - levels[0] < -8
    assert -22 < levels[2] - levels[0] < -10
    assert surface_db(60, NONE) - surface_db(0, NONE) < -35


def test_normals_turn_with_the_tissue():
    """A shear that lays the surface square to the beam makes it as bright as one that was; undeformed, it is dark."""
    grid = ss.Grid.covering((90, 30, 60), nodes=2000)
    shear = np.zeros((*grid.shape, 3), np.float32)
    shear[..., 2] = np.tan(np.radians(-20.0)) * (grid.points[:, 0].reshape(grid.shape) - 45)
    turned = ss.GridField(grid, shear)
    mirror = replace(OIL, roughness_db=-60)

    def level(artefacts):
        tilt = np.radians(20.0)
        depth = np.array([np.sin(tilt), 0, np.cos(tilt)])
        pose = facing(np.array([45, 15, 23.5]) - 22 * depth, depth=depth, right=(np.cos(tilt), 0, -np.sin(tilt)))
        made = Scanner(halves(mirror), SMALL, pose, display=QUIET, artefacts=artefacts, margin_mm=20)
        return 20 * np.log10(made.render(turned).envelope[28:36].max())

    assert level(SURFACES) == pytest.approx(surface_db(0, SURFACES), abs=3)
    assert level(NONE) < level(SURFACES) - 5


def test_a_fluid_has_a_wall_of_two_lines():
    fluid = replace(OIL, name="fluid", wall_mm=1.5)

    def peaks(below, artefacts):
        pose = facing((45, 15, 2), depth=(0, 0, 1), right=(1, 0, 0))
        image = Scanner(halves(below), SMALL, pose, display=QUIET, artefacts=artefacts).render()
        line = np.mean(image.envelope[20:44], axis=0)
        loud = np.flatnonzero((line[1:-1] > line[:-2]) & (line[1:-1] >= line[2:]) & (line[1:-1] > 0.1 * line.max()))
        return (loud + 1) * SMALL.sample_mm

    assert len(peaks(OIL, SURFACES)) == len(peaks(fluid, NONE)) == 1
    assert np.ptp(peaks(fluid, SURFACES)) == pytest.approx(1.5, abs=0.1)


def cyst(diameter_mm=7.0, depth_mm=60.0):
    """A probe over liver with a ball of fluid in it, and the lines and samples well inside that ball."""
    voxels = np.zeros((161, 41, 181), np.uint8)
    place = [
        (np.arange(n) * 0.5).reshape([-1 if a == axis else 1 for a in range(3)]) for axis, n in enumerate(voxels.shape)
    ]
    voxels[sum((p - c) ** 2 for p, c in zip(place, (40, 10, depth_mm + 4), strict=True)) < (diameter_mm / 2) ** 2] = 1
    phantom = Phantom(Volume(voxels=voxels, spacing=(0.5,) * 3), {0: "liver", 1: "urine"})
    probe = Probe.curvilinear(depth_mm=80, lines=96, aperture_mm=30)
    pose = facing((40, 10, 4), depth=(0, 0, 1), right=(1, 0, 0))
    inside = np.s_[45:51, round((depth_mm - 1) / probe.sample_mm) : round((depth_mm + 1) / probe.sample_mm)]
    return phantom, probe, pose, inside


@pytest.mark.slow
def test_a_small_cyst_is_dark_and_not_black():
    phantom, probe, pose, inside = cyst()
    grey = {
        name: Scanner(phantom, heard, pose, display=FLAT, artefacts=artefacts).render().beams[inside].mean()
        for name, heard, artefacts in (
            ("none", probe, NONE),
            ("all", probe, Artefacts()),
            ("harmonic", probe.in_harmonic_mode(), Artefacts()),
        )
    }
    assert grey["none"] < 8
    assert 8 < grey["all"] < 60
    assert grey["harmonic"] < grey["all"]


def test_what_swallows_sound_is_not_seen_from_inside():
    """Of a slab that attenuates like bone the far face has no points; of one that does not, both have."""
    voxels = np.zeros((60, 30, 60), np.uint8)
    voxels[:, :, 20:30] = 1
    pose = facing((30, 15, 2), depth=(0, 0, 1), right=(1, 0, 0))
    points = []
    for loss in (0.5, 15):
        slab = replace(OIL, name="slab", speed_m_s=3000, density_kg_m3=1900, attenuation_db_cm_mhz=loss)
        phantom = Phantom(Volume(voxels=voxels, spacing=(1, 1, 1)), {0: OIL, 1: slab})
        grid = ss.Grid.covering((60, 30, 60), nodes=2000)
        points.append(aim(phantom, Optics(SMALL), pose, grid, 1.0, 0, diffuse=True).surface_starts[-1])
    assert points[1] == pytest.approx(points[0] / 2, rel=0.1)


@pytest.mark.parametrize("part", ["side_lobes_db", "grating_db", "haze_db", "tail_db"])
def test_every_level_is_a_switch_and_a_number(part):
    """Off it adds nothing; 20 dB more are 20 dB more."""
    clean = liver_scanner(LINEAR).render().iq

    def added(level):
        return liver_scanner(LINEAR, artefacts=replace(NONE, **{part: level})).render().iq - clean

    assert not added(None).any()
    assert np.linalg.norm(added(-20.0)) == pytest.approx(10 * np.linalg.norm(added(-40.0)), rel=0.02)


def test_side_lobes_stand_at_their_level_in_uniform_speckle():
    clean = liver_scanner(CURVED)
    lobes = liver_scanner(CURVED, artefacts=replace(NONE, side_lobes_db=-20.0))
    added = lobes.render().iq - clean.render().iq
    middle = np.s_[30:-30, 150:-60]
    power = np.abs(added[middle]) ** 2 / clean.optics.speckle_power[middle[1]]
    lost = np.abs(clean.render().iq[middle]) ** 2 / clean.optics.speckle_power[middle[1]]
    assert 10 * np.log10(power.mean() / lost.mean()) == pytest.approx(-20, abs=1)


def test_side_lobes_are_louder_off_the_transmit_focus():
    focused = replace(CURVED, transmit_focus_mm=30.0)

    def added(defocus):
        parts = replace(NONE, side_lobes_db=-20.0, defocus_db=defocus)
        return liver_scanner(focused, artefacts=parts).render().iq - liver_scanner(focused).render().iq

    louder = np.abs(added(6.0)).sum(axis=0) / np.abs(added(None)).sum(axis=0)
    at = int(30 / focused.sample_mm)
    assert louder[at] == pytest.approx(1, abs=0.02)
    assert 1.4 < louder[-50] < 2.01


def test_harmonic_mode_lowers_each_part_by_its_share_or_nothing():
    lowered = Artefacts(harmonic_db=6.0).in_harmonic_mode()
    assert (lowered.side_lobes_db, lowered.haze_db, lowered.tail_db) == (-28, -4, -33)
    assert Artefacts(harmonic_db=None).in_harmonic_mode() == Artefacts(harmonic_db=None)


def over_bone(degrees, multiples_db):
    """Loudest echo over liver at the distance of a face of bone, and at twice and three times as much, dB."""
    voxels = np.zeros((90, 30, 60), np.uint8)
    voxels[:, :, 14:] = 1
    tilt = np.radians(degrees)
    depth = (np.sin(tilt), 0, np.cos(tilt))
    pose = facing(np.array([45, 15, 13.5]) - 12 * np.array(depth), depth=depth, right=(np.cos(tilt), 0, -np.sin(tilt)))
    probe = Probe.curvilinear(depth_mm=55, lines=64, aperture_mm=40)
    phantom = Phantom(Volume(voxels=voxels, spacing=(1, 1, 1)), {0: OIL, 1: "bone"})
    image = Scanner(phantom, probe, pose, display=QUIET, artefacts=replace(NONE, multiples_db=multiples_db)).render()
    level = 20 * np.log10(image.envelope[28:36].max(axis=0) / np.sqrt(image.optics.speckle_power))
    return [level[np.abs(probe.ranges - 12 * k) < 1].max() for k in (1, 2, 3)]


def test_a_flat_reflector_is_seen_again_at_multiples_of_its_distance():
    """The face and bone send it back each time: as much is lost from the second to the third as from the first."""
    first, second, third = over_bone(0, -12.0)
    assert 8 < first - second < 22
    assert second - third == pytest.approx(first - second, abs=1)
    softer = over_bone(0, -18.0)
    assert softer[0] == first
    assert second - softer[1] == pytest.approx(6, abs=0.2)
    assert over_bone(20, -12.0)[1] < -60
    assert over_bone(0, None)[1] < -60


def test_multiples_of_what_is_too_deep_to_come_again_overflow_nothing():
    probe = Probe.linear(frequency_mhz=20, depth_mm=250, lines=16, aperture_mm=4)
    phantom = Phantom.uniform("gel", size_mm=(8, 4, 20))
    pose = facing((4, 2, 1), depth=(0, 0, 1), right=(1, 0, 0))
    with np.errstate(over="raise", invalid="raise"):
        image = Scanner(phantom, probe, pose, artefacts=replace(NONE, multiples_db=-12.0)).render()
    assert np.isfinite(image.iq).all()


def lit_point(probe, depth_mm, grating_db):
    """Beams over nothing but the tip of a short needle on the middle beam."""
    phantom = Phantom.uniform(OIL, size_mm=(140, 30, probe.depth_mm + 8))
    pose = facing((70, 15, 4), depth=(0, 0, 1), right=(1, 0, 0))
    scanner = Scanner(phantom, probe, pose, display=QUIET, artefacts=replace(NONE, grating_db=grating_db))
    return scanner.render(needle=ss.Needle((70, 15, depth_mm + 3.8), (70, 15, depth_mm + 4))).iq


@pytest.mark.parametrize("probe", [LINEAR, CURVED], ids=lambda p: p.kind)
def test_grating_lobes_hear_a_bright_point_from_their_angle(probe):
    """Beside it, and further along the beam than it lies, at SIMUS's level."""
    angle = grating.angle(probe)
    far = 0.3 * probe.depth_mm
    lit = lit_point(probe, far, -48.0) - lit_point(probe, far, None)
    power = np.square(np.abs(lit))
    line, sample = np.unravel_index(power[: probe.lines // 2].argmax(), power[: probe.lines // 2].shape)
    x, y = np.array([0.0, far]) - probe.image_points(np.array([[0.0, line, 0.0]]))[0, :2]
    start, ahead = probe.beam_lines(probe.lines)[line, :2], probe.beam_lines(probe.lines)[line, 2:]
    seen = np.degrees(np.arccos((np.array([0, far]) - start) @ ahead / np.hypot(*(np.array([0, far]) - start))))
    assert seen == pytest.approx(np.degrees(angle), abs=4)
    assert probe.ranges[sample] == pytest.approx(np.hypot(x, y), abs=2.5)
    peak = np.abs(lit_point(probe, far, None)).max()
    assert 20 * np.log10(np.abs(lit).max() / peak) == pytest.approx(-48, abs=6)


def test_a_phased_probe_has_no_grating_lobes():
    assert grating.angle(Probe.phased()) is None


def test_haze_lies_under_the_face_alone():
    hazy = liver_scanner(LINEAR, artefacts=replace(NONE, haze_db=0.0)).render().envelope
    clean = liver_scanner(LINEAR).render().envelope
    assert np.array_equal(hazy[:, 700:], clean[:, 700:])
    assert hazy[:, :30].mean() > 1.3 * clean[:, :30].mean()


@needs_core
@pytest.mark.slow
@pytest.mark.parametrize("probe", [LINEAR, CURVED, Probe.phased(depth_mm=100, lines=128)], ids=lambda p: p.kind)
def test_every_instruction_set_agrees_with_the_twin_with_all_parts_on(probe, native, monkeypatch):
    voxels = np.zeros((70, 30, 60), np.uint8)
    voxels[:, :, 20:40], voxels[30:, :, 40:], voxels[20:30, :, 10:18] = 1, 2, 3
    pose = facing((35, 18, 1), depth=(0.2, 0.1, 1), right=(1, 0.3, 0))
    x, y, z = ((np.indices(voxels.shape).T * (1, 1.2, 1.1) - pose[:3, 3]) @ pose[:3, :3]).T
    voxels[(abs(x - 4) < 6) & (abs(y - 13 - ((x - 4) ** 2 + z**2) / 120) < 2)] = 4  # square to a beam, in every image
    names = {0: "liver", 1: "muscle", 2: "urine", 3: "blood", 4: "bone"}
    phantom = Phantom(Volume(voxels=voxels, spacing=(1, 1.2, 1.1)), names)
    field, needle = a_field((70, 36, 66)), ss.Needle((60, 15, 10), (40, 18, 40))

    def image(back_end, **changed):
        monkeypatch.setattr(_core, "active", back_end)
        return Scanner(phantom, probe, pose, artefacts=Artefacts(**changed)).render(field, needle, frame=1)

    expected = image(_core.twin)
    assert (expected.beams != image(_core.twin, multiples_db=None).beams).sum() > 40
    weight = 1 / np.sqrt(expected.optics.speckle_power)
    rms = np.sqrt(np.mean(np.abs(expected.iq * weight) ** 2))
    for name in INSTRUCTION_SETS:
        native.use_instruction_set(name)
        found = image(native)
        assert np.sqrt(np.mean(np.abs((found.iq - expected.iq) * weight) ** 2)) < 1e-4 * rms
        assert np.abs(found.beams.astype(int) - expected.beams).max() <= 1


def test_a_moved_scanner_shows_what_a_new_one_would():
    scanner = liver_scanner(CURVED, artefacts=Artefacts())
    before = scanner.render(a_field()).iq
    pose = facing((72, 14, 5), depth=(0.1, 0.05, 1), right=(1, 0, 0))
    new = Scanner(scanner.phantom, CURVED, pose, display=FLAT, margin_mm=0.2, artefacts=Artefacts())
    assert np.array_equal(scanner.moved(pose).render(a_field()).iq, new.render(a_field()).iq)
    assert np.array_equal(scanner.render(a_field()).iq, before)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: Artefacts(haze_db=np.nan), "haze_db"),
        (lambda: Artefacts(side_lobes_db=40), "side_lobes_db = 40 is too loud"),
        (lambda: Artefacts(multiples_db=0), "multiples_db = 0 sends back more than there was"),
        (lambda: replace(OIL, roughness_db=3), "roughness_db = 3 of oil"),
        (lambda: replace(OIL, wall_mm=-1), "wall_mm"),
        (lambda: liver_scanner(LINEAR, artefacts="all"), "artefacts = 'all'"),
    ],
)
def test_levels_that_are_none_are_refused(made, message):
    with pytest.raises(ValueError, match=message):
        made()
