"""Synthetic B-mode: speckle statistics, its motion, attenuation, and the twin."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import fftconvolve

import sonospline as ss
from builds import needs_core
from sonospline import _core
from sonospline.ultrasound import TISSUES, AcousticTissue, Display, Probe, Scene, Ultrasound, facing
from sonospline.ultrasound.aim import aim
from sonospline.ultrasound.optics import CUT_WEIGHT, Optics
from sonospline.volume import Volume

LINEAR = Probe.linear(depth_mm=40, lines=128, aperture_mm=25.4)
CURVED = Probe.curvilinear(depth_mm=100, lines=128, aperture_mm=42)
FLAT = Display(tgc_db_cm_mhz=0.5)
EDGE = 15  # lines left out on either side
SEEDS = range(4)


def liver_scanner(probe, seed=0, **settings):
    """A probe on liver that fills its slice."""
    depth = probe.depth_mm + 8
    scene = Scene.uniform("liver", size_mm=(140, 30, depth))
    pose = facing((70, 15, 4), depth=(0, 0, 1), right=(1, 0, 0))
    return Ultrasound(scene, probe, pose, display=FLAT, seed=seed, **({"margin_mm": 0.2} | settings))


def speckle(image):
    """Envelope away from the edges, over its rms at each depth."""
    part = image.envelope[EDGE:-EDGE, 80:-40].astype(float)
    rms = np.sqrt(np.mean(part**2, axis=0))
    smooth = np.convolve(np.pad(rms, 40, mode="edge"), np.ones(81) / 81, mode="valid")
    return part / smooth


@pytest.fixture(scope="module", params=[LINEAR, CURVED], ids=lambda p: p.kind)
def speckled(request):
    """A probe and its images of liver, one a seed."""
    return request.param, [liver_scanner(request.param, seed).render() for seed in SEEDS]


# --- speckle ---


def test_the_signal_to_noise_ratio_is_rayleighs(speckled):
    _, images = speckled
    envelope = np.concatenate([speckle(image) for image in images])
    assert envelope.mean() / envelope.std() == pytest.approx(np.sqrt(np.pi / (4 - np.pi)), rel=0.03)


def test_the_envelope_is_rayleigh_distributed(speckled):
    probe, images = speckled
    along = int(np.ceil(2.0 * 2.355 * probe.axial_sigma / probe.sample_mm))
    for image in images:
        sample = speckle(image)[::4, ::along]  # samples some resolution cells apart
        independent = sample.ravel() / np.sqrt(np.mean(sample**2))
        assert len(independent) > 500
        assert stats.kstest(independent, stats.rayleigh(scale=np.sqrt(0.5)).cdf).pvalue > 0.01


def test_mean_brightness_is_flat_in_depth(speckled):
    probe, images = speckled
    power = np.mean([np.mean(np.abs(image.iq[EDGE:-EDGE]) ** 2, axis=0) for image in images], axis=0)
    tgc = 2 * 0.5 * probe.frequency_mhz * probe.ranges / 10
    level = 10 * np.log10(power / images[0].optics.speckle_power) + tgc
    bands = level[64:].reshape(15, -1)
    bands = 10 * np.log10(np.mean(10 ** (bands / 10), axis=1))
    assert np.abs(bands).max() < 1.0


def half_width(covariance, step):
    """Full width at half maximum of a covariance that falls from its first value."""
    below = np.flatnonzero(covariance < 0.5 * covariance[0])[0]
    high, low = covariance[below - 1 : below + 1] / covariance[0]
    return 2 * step * (below - 1 + (high - 0.5) / (high - low))


@pytest.mark.slow
@pytest.mark.parametrize("probe", [LINEAR, CURVED], ids=lambda p: p.kind)
def test_autocovariance_widths_follow_pulse_and_beam(probe):
    window = slice(440, 600)
    axial, lateral = [], []
    for seed in range(8):
        intensity = speckle(liver_scanner(probe, seed).render())[:, window] ** 2
        intensity -= intensity.mean()
        axial.append([np.mean(intensity[:, : 160 - k] * intensity[:, k:]) for k in range(40)])
        lateral.append([np.mean(intensity[: len(intensity) - k] * intensity[k:]) for k in range(3)])
    middle = probe.sample_mm * (80 + 520)
    wanted_axial, wanted_lateral = 2.3548 * probe.axial_sigma, float(probe.lateral_fwhm(middle))
    assert half_width(np.mean(axial, axis=0), probe.sample_mm) == pytest.approx(wanted_axial, rel=0.1)
    # Lines are half a beam apart: the width of the Gaussian follows from its first lag.
    covariance = np.mean(lateral, axis=0)
    found = 2.3548 * float(probe.line_spacing(middle)) / np.sqrt(2 * np.log(covariance[0] / covariance[1]))
    assert found == pytest.approx(wanted_lateral, rel=0.1)


def shifted(scanner, displacement):
    """The image of tissue moved as a whole."""
    grid = ss.Grid(shape=(4, 4, 4), spacing=(60, 20, 60), origin=(-20, -10, -20))
    return scanner.render(
        ss.GridField(grid, np.broadcast_to(np.asarray(displacement, np.float32), (4, 4, 4, 3)).copy())
    )


@pytest.mark.slow
def test_elevational_motion_decorrelates_as_theory_says():
    scanners = [liver_scanner(LINEAR, seed) for seed in SEEDS]
    focus = int(LINEAR.elevation_focus_mm / LINEAR.sample_mm) - 80
    sigma = float(LINEAR.elevation_sigma(20.0))
    still = np.concatenate([speckle(scanner.render())[:, focus - 150 : focus + 150] for scanner in scanners]) ** 2
    y = np.linspace(-8, 8, 4001)

    def profile(offset):
        return np.maximum(np.exp(-((y - offset) ** 2) / 2) - CUT_WEIGHT, 0)

    for steps in (0.5, 1.0, 1.5, 2.0):
        moved = [speckle(shifted(s, (0, steps * sigma, 0)))[:, focus - 150 : focus + 150] for s in scanners]
        found = np.corrcoef(still.ravel(), (np.concatenate(moved) ** 2).ravel())[0, 1]
        wanted = ((profile(0) * profile(steps)).sum() / (profile(0) ** 2).sum()) ** 2
        assert found == pytest.approx(wanted, abs=0.06)
        assert found == pytest.approx(np.exp(-(steps**2) / 2), abs=0.08)  # a Gaussian slice without the cut


def test_an_axial_shift_moves_speckle_with_its_phase():
    scanner = liver_scanner(LINEAR)
    samples = 3
    still, moved = scanner.render().iq, shifted(scanner, (0, 0, samples * LINEAR.sample_mm)).iq
    turn = np.exp(-2j * np.pi * scanner.optics.cycles_per_mm * samples * LINEAR.sample_mm)
    a, b = still[EDGE:-EDGE, 200:800] * turn, moved[EDGE:-EDGE, 200 + samples : 800 + samples]
    coherence = np.vdot(a, b) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)
    assert coherence.real > 0.99
    assert abs(coherence.imag) < 0.01


# --- motion ---


def block_shift(first, second, at, size, search):
    """Sub-sample shift of one block by normalised cross-correlation, and its score."""
    i, j = at
    template = first[i : i + size[0], j : j + size[1]].astype(float)
    template = template - template.mean()
    window = second[i - search[0] : i + size[0] + search[0], j - search[1] : j + size[1] + search[1]].astype(float)
    ones = np.ones(size)
    product = fftconvolve(window, template[::-1, ::-1], mode="valid")
    total, squares = (fftconvolve(w, ones, mode="valid") for w in (window, window**2))
    score = product / np.sqrt(np.maximum(squares - total**2 / template.size, 1e-9) * (template**2).sum())
    peak = np.unravel_index(score.argmax(), score.shape)
    shift = []
    for axis in range(2):
        if not 0 < peak[axis] < score.shape[axis] - 1:
            return None
        before, here, after = (
            score[tuple(p + (step if a == axis else 0) for a, p in enumerate(peak))] for step in (-1, 0, 1)
        )
        shift.append(peak[axis] - search[axis] + 0.5 * (before - after) / (before - 2 * here + after))
    return np.array(shift)


def test_speckle_moves_with_the_tissue():
    """Block matching between frames before and after a needle step recovers the model's displacement."""
    probe = Probe.linear(depth_mm=40, lines=192, aperture_mm=38.2)
    scene = Scene.uniform("liver", size_mm=(60, 30, 52))
    scanner = Ultrasound(scene, probe, facing((30, 15, 4), depth=(0, 0, 1), right=(1, 0, 0)), display=FLAT)
    grid = ss.Grid.covering((60, 30, 52), nodes=60_000)
    insertion = ss.Insertion(ss.Tissue(grid, entry_face="x-"), model=ss.NeedleTissueModel.paper(60.0))
    deeper = [ss.GridField.of(insertion.advance(ss.Needle((0, 15, 16), tip))) for tip in ((10, 15, 17), (44, 15, 30))]
    before, after = (scanner.render(field).beams for field in deeper)
    step = np.array([float(probe.line_spacing(0.0)), probe.sample_mm])
    size = np.rint(np.array([4.0, 2.4]) / step).astype(int)
    errors, sizes = [], []
    for i in range(24, 192 - 24 - size[0], 9):
        for j in range(110, 1024 - 110 - size[1], 40):
            centre = np.array([[j + size[1] / 2, i + size[0] / 2, 0]]) * [probe.sample_mm, 1, 1]
            world = scanner.plane.image_to_reference[:3, :3] @ probe.image_points(centre)[0] + [30, 15, 4]
            material = deeper[0].inverse(world[None])
            moved = deeper[1].forward(material)[0] - world
            if not 0.3 <= np.hypot(moved[0], moved[2]) <= 1.5:
                continue
            found = block_shift(before, after, (i, j), size, (14, 70))
            if found is None:
                errors.append(np.inf)
                continue
            errors.append(np.hypot(*(found * step - [moved[0], moved[2]])))
            sizes.append(np.hypot(moved[0], moved[2]))
    assert len(errors) > 150
    assert min(sizes) < 0.35
    assert max(sizes) > 1.45
    assert np.median(errors) <= 0.05


# --- the chain ---


def two_layers(tissue):
    """Liver over 15 mm of something over liver."""
    voxels = np.zeros((60, 30, 60), np.uint8)
    voxels[:, :, 24:39] = 1
    return Scene(Volume(voxels=voxels, spacing=(1, 1, 1)), {0: "liver", 1: tissue})


@pytest.mark.parametrize("name", ["urine", pytest.param("muscle", marks=pytest.mark.slow)])
def test_what_lies_behind_is_attenuated_as_the_table_says(name):
    probe = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
    pose = facing((30, 15, 2), depth=(0, 0, 1), right=(1, 0, 0))
    quiet = Display(noise_db=-150)

    def behind(scene):
        powers = [
            np.mean(
                np.abs(Ultrasound(scene, probe, pose, display=quiet, seed=s, margin_mm=0.2).render().iq[:, 820:]) ** 2
            )
            for s in SEEDS
        ]
        return 10 * np.log10(np.mean(powers))

    tissue, liver = TISSUES[name], TISSUES["liver"]
    reflection = (tissue.impedance - liver.impedance) / (tissue.impedance + liver.impedance)
    wanted = 2 * (liver.attenuation_db_cm_mhz - tissue.attenuation_db_cm_mhz) * 7.5 * 1.5
    wanted += 2 * 20 * np.log10(1 - reflection**2)
    assert behind(two_layers(name)) - behind(two_layers("liver")) == pytest.approx(wanted, abs=0.7)


@pytest.mark.parametrize("name", ["bone", "gas"])
def test_bone_and_gas_cast_a_black_shadow_under_a_bright_surface(name):
    probe = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
    beams = Ultrasound(two_layers(name), probe, facing((30, 15, 2), depth=(0, 0, 1), right=(1, 0, 0))).render().beams
    surface = int((24 - 0.5 - 2) / probe.sample_mm)
    assert beams[8:-8, surface - 8 : surface + 12].max(axis=1).mean() > beams[8:-8, 100:300].mean() + 40
    assert beams[:, surface + 120 : surface + 300].mean() < 10


def test_a_tilted_surface_is_darker_than_a_square_one():
    probe = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
    silent = AcousticTissue(name="oil", speed_m_s=1400, density_kg_m3=900, attenuation_db_cm_mhz=0, backscatter_db=-200)
    layers = two_layers("fat")
    fluids = Scene(layers.labels, {0: "gel", 1: silent})
    glint = []
    for degrees in (0, 30):
        tilt = np.radians(degrees)
        depth = (np.sin(tilt), 0, np.cos(tilt))
        start = np.array([30, 15, 24]) - 22 * np.array(depth)
        image = Ultrasound(fluids, probe, facing(start, depth=depth, right=(1, 0, 0))).render()
        middle = image.envelope[28:36, 430:475]
        glint.append(20 * np.log10(middle.max()))
    assert glint[0] > glint[1] + 12


def test_the_knobs_do_what_they_say():
    scanner = liver_scanner(LINEAR)
    plain, louder = scanner.render(), scanner.with_display(gain_db=-25.0).render()
    grey = plain.beams[EDGE:-EDGE, 100:900].astype(int)
    middling = (grey > 20) & (grey < 200)
    change = louder.beams[EDGE:-EDGE, 100:900].astype(int)[middling] - grey[middling]
    assert np.abs(change - 6 * 255 / 60).max() <= 1
    assert scanner.with_display(range_db=40.0).render().beams.std() > plain.beams.std()


def test_the_same_seed_gives_the_same_bits():
    images = [liver_scanner(CURVED, seed).render(frame=2) for seed in (3, 3, 4)]
    assert np.array_equal(images[0].iq, images[1].iq)
    assert not np.array_equal(images[0].iq, images[2].iq)
    assert not np.array_equal(images[0].iq, liver_scanner(CURVED, 3).render(frame=5).iq)


@needs_core
def test_the_number_of_threads_changes_no_bit():
    scanner = liver_scanner(CURVED)
    threads = _core.native.thread_count()
    try:
        images = []
        for count in (1, 2, 3):
            _core.native.set_thread_count(count)
            images.append(scanner.render().iq)
    finally:
        _core.native.set_thread_count(threads)
    assert np.array_equal(images[0], images[1])
    assert np.array_equal(images[0], images[2])


def a_field(size=(140, 30, 108)):
    """A smooth field of a few millimetres with a cusp."""
    grid = ss.Grid.covering(size, nodes=20_000)
    away = np.linalg.norm(grid.points - np.array(size) / 2, axis=1)
    values = 2.5 * np.exp(-away / 20)[:, None] * [0.8, 0.2, 0.6]
    return ss.GridField(grid, values.reshape(*grid.shape, 3).astype(np.float32))


@needs_core
@pytest.mark.parametrize("probe", [LINEAR, CURVED, Probe.phased(depth_mm=100, lines=128)], ids=lambda p: p.kind)
def test_every_instruction_set_agrees_with_the_twin(probe, monkeypatch):
    field, needle = a_field(), ss.Needle((40, 15, 10), (75, 16, 40))

    def image(back_end):
        monkeypatch.setattr(_core, "active", back_end)
        return liver_scanner(probe).render(field, needle, frame=1)

    expected = image(_core.twin)
    weight = 1 / np.sqrt(expected.optics.speckle_power)
    rms = np.sqrt(np.mean(np.abs(expected.iq * weight) ** 2))
    used = _core.native.instruction_set()
    try:
        for name in _core.native.instruction_sets():
            _core.native.use_instruction_set(name)
            found = image(_core.native)
            assert np.sqrt(np.mean(np.abs((found.iq - expected.iq) * weight) ** 2)) < 1e-4 * rms
            assert np.abs(found.beams.astype(int) - expected.beams).max() <= 1
            assert np.abs(found.frame.pixels.astype(int) - expected.frame.pixels).max() <= 2
    finally:
        _core.native.use_instruction_set(used)


@needs_core
@pytest.mark.parametrize("probe", [LINEAR, CURVED, Probe.phased(depth_mm=100, lines=128)], ids=lambda p: p.kind)
def test_every_instruction_set_chooses_the_scatterers_of_the_twin(probe, monkeypatch):
    """In a scene with textures and interfaces, seen obliquely, over a lattice turned against it."""
    voxels = np.zeros((70, 30, 60), np.uint8)
    voxels[:, :, 20:40], voxels[30:, :, 40:] = 1, 2
    scene = Scene(Volume(voxels=voxels, spacing=(1, 1.2, 1.1)), {0: "liver", 1: "muscle", 2: "urine"})
    pose = facing((35, 18, 1), depth=(0.2, 0.1, 1), right=(1, 0.3, 0))
    turn = facing((0, 0, 0), depth=(0.1, 1, 0), right=(1, 0, 0.2))[:3, :3]
    grid = ss.Grid(shape=(20, 9, 18), spacing=(3, 4, 3.5), origin=(5, -2, 3), direction=turn)

    def chosen():
        frames, nodes, starts, place, amplitude, step = aim(scene, Optics(probe), pose, grid, 3.0, 5)[:6]
        cell = np.repeat(np.arange(len(nodes)), np.diff(starts))
        each = [nodes[cell, :1], frames[cell][:, :14], place[:, : len(cell)].T / 65536, amplitude[: len(cell)] * step]
        table = np.column_stack(each)
        return table[np.lexsort(np.round(table[:, [0, 15, 16, 17]], 3).T)]

    monkeypatch.setattr(_core, "active", _core.twin)
    expected = chosen()
    monkeypatch.setattr(_core, "active", _core.native)
    used = _core.native.instruction_set()
    try:
        for name in _core.native.instruction_sets():
            _core.native.use_instruction_set(name)
            found = chosen()
            assert found.shape == expected.shape
            assert len(found) > 20_000
            assert np.mean(np.abs(found - expected).max(axis=1) > 1e-4) < 1e-3
    finally:
        _core.native.use_instruction_set(used)


def test_a_moved_probe_shows_what_a_new_one_would():
    scanner = liver_scanner(CURVED)
    before = scanner.render(a_field()).iq
    pose = facing((72, 14, 5), depth=(0.1, 0.05, 1), right=(1, 0, 0))
    moved = scanner.moved(pose)
    new = Ultrasound(scanner.scene, CURVED, pose, display=FLAT, margin_mm=0.2)
    assert np.array_equal(moved.render(a_field()).iq, new.render(a_field()).iq)
    assert np.allclose(moved.image_to_reference, pose)
    assert np.array_equal(scanner.render(a_field()).iq, before)


def test_another_setting_of_the_probe_shows_what_a_new_scanner_would():
    scanner = liver_scanner(CURVED)
    before = scanner.render(a_field()).iq
    for probe in (replace(CURVED, depth_mm=80, frequency_mhz=4.5, elevation_focus_mm=40), LINEAR):
        other = scanner.with_probe(probe)
        new = Ultrasound(
            scanner.scene, probe, scanner.image_to_reference, display=FLAT, margin_mm=0.2,
            picture_shape=scanner.plane.shape,
        )  # fmt: skip
        found, expected = other.render(a_field()), new.render(a_field())
        assert np.array_equal(found.iq, expected.iq)
        assert np.array_equal(found.frame.pixels, expected.frame.pixels)
        assert np.array_equal(found.frame.mask, expected.frame.mask)
    assert np.array_equal(scanner.render(a_field()).iq, before)
    with pytest.raises(ValueError, match="probe = str"):
        scanner.with_probe("linear")


def test_a_field_on_a_lattice_of_its_own_is_sampled_on_its_grid():
    field = a_field()
    coarse = ss.Grid.covering((140, 30, 108), nodes=2000)
    other = ss.GridField(field.grid, field.displacement(coarse.points).reshape(*coarse.shape, 3), lattice=coarse)
    at_nodes = ss.GridField(field.grid, other.on_grid())
    scanner = liver_scanner(LINEAR)
    assert np.array_equal(scanner.render(other).iq, scanner.render(at_nodes).iq)


# --- rendering never stops a simulation; what is wrong is said at the border ---


def test_a_probe_that_sees_nothing_gives_a_black_picture_and_a_warning(caplog):
    scene = Scene.uniform("liver", size_mm=(30, 10, 30))
    away = Ultrasound(scene, LINEAR, facing((500, 0, 0), depth=(0, 0, 1), right=(1, 0, 0)))
    with caplog.at_level(logging.WARNING):
        image = away.render()
    assert "sees nothing" in caplog.text
    assert image.frame.pixels.mean() < 5


def test_a_field_with_nan_is_left_out_with_a_warning(caplog):
    scanner, field = liver_scanner(LINEAR), a_field()
    values = field.values.copy()
    values[3, 3, 3] = np.nan
    with caplog.at_level(logging.WARNING):
        image = scanner.render(ss.GridField(field.grid, values))
    assert "NaN" in caplog.text
    assert np.array_equal(image.iq, scanner.render().iq)


@pytest.mark.slow
def test_a_displacement_beyond_the_margin_chooses_scatterers_anew():
    scanner = liver_scanner(LINEAR)
    far = shifted(scanner, (0, 6.0, 0))
    envelope = speckle(far)
    assert envelope.mean() / envelope.std() == pytest.approx(1.913, rel=0.06)
    still = scanner.render().envelope[EDGE:-EDGE, 100:900]
    assert np.mean(far.envelope[EDGE:-EDGE, 100:900] ** 2) == pytest.approx(np.mean(still**2), rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None, LINEAR, np.eye(4)), "scene = NoneType"),
        (("scene", None, np.eye(4)), "probe = NoneType"),
        (("scene", LINEAR, np.zeros((4, 4))), "not rigid"),
    ],
)
def test_what_is_no_scanner_is_refused(arguments, message):
    scene = Scene.uniform("liver", size_mm=(30, 10, 30)) if arguments[0] else None
    with pytest.raises(ValueError, match=message):
        Ultrasound(scene, *arguments[1:])


def test_a_tissue_that_is_none_is_refused():
    with pytest.raises(ValueError, match="density_kg_m3"):
        AcousticTissue(name="x", speed_m_s=1500, density_kg_m3=0, attenuation_db_cm_mhz=1, backscatter_db=0)
    with pytest.raises(ValueError, match="backscatter_db"):
        AcousticTissue(name="x", speed_m_s=1500, density_kg_m3=1000, attenuation_db_cm_mhz=1, backscatter_db=np.nan)
    with pytest.raises(ValueError, match="range_db"):
        Display(range_db=0)


def test_scanners_that_differ_in_display_share_what_was_computed_and_do_not_disturb_each_other():
    scanner = liver_scanner(LINEAR)
    louder = scanner.with_display(gain_db=-20.0)
    field = a_field()
    first = scanner.render(field).iq
    louder.render()  # on another lattice
    assert np.array_equal(scanner.render(field).iq, first)
