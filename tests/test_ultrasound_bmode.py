"""Synthetic B-mode: attenuation, shadows, the knobs, the twin, and what is refused."""

import logging
from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from builds import INSTRUCTION_SETS, needs_core
from liver import CURVED, EDGE, FLAT, LINEAR, SEEDS, a_field, liver_scanner
from sonospline import _core
from sonospline.geometry import facing
from sonospline.geometry.volume import Volume
from sonospline.ultrasound import TISSUES, AcousticTissue, Display, Phantom, Probe, Scanner
from sonospline.ultrasound.aim import aim
from sonospline.ultrasound.optics import Optics


def two_layers(tissue):
    """Liver over 15 mm of something over liver."""
    voxels = np.zeros((60, 30, 60), np.uint8)
    voxels[:, :, 24:39] = 1
    return Phantom(Volume(voxels=voxels, spacing=(1, 1, 1)), {0: "liver", 1: tissue})


@pytest.mark.parametrize("name", ["urine", pytest.param("muscle", marks=pytest.mark.slow)])
def test_what_lies_behind_is_attenuated_as_the_table_says(name):
    probe = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
    pose = facing((30, 15, 2), depth=(0, 0, 1), right=(1, 0, 0))
    quiet = Display(noise_db=-150)

    def behind(phantom):
        powers = [
            np.mean(
                np.abs(Scanner(phantom, probe, pose, display=quiet, seed=s, margin_mm=0.2).render().iq[:, 820:]) ** 2
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
    beams = Scanner(two_layers(name), probe, facing((30, 15, 2), depth=(0, 0, 1), right=(1, 0, 0))).render().beams
    surface = int((24 - 0.5 - 2) / probe.sample_mm)
    assert beams[8:-8, surface - 8 : surface + 12].max(axis=1).mean() > beams[8:-8, 100:300].mean() + 40
    assert beams[:, surface + 120 : surface + 300].mean() < 10


def test_a_tilted_surface_is_darker_than_a_square_one():
    probe = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
    silent = AcousticTissue(name="oil", speed_m_s=1400, density_kg_m3=900, attenuation_db_cm_mhz=0, backscatter_db=-200)
    layers = two_layers("fat")
    fluids = Phantom(layers.labels, {0: "gel", 1: silent})
    glint = []
    for degrees in (0, 30):
        tilt = np.radians(degrees)
        depth = (np.sin(tilt), 0, np.cos(tilt))
        start = np.array([30, 15, 24]) - 22 * np.array(depth)
        image = Scanner(fluids, probe, facing(start, depth=depth, right=(1, 0, 0))).render()
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
def test_the_number_of_threads_changes_no_bit(native):
    scanner = liver_scanner(CURVED)
    images = []
    for count in (1, 2, 3):
        native.set_thread_count(count)
        images.append(scanner.render().iq)
    assert np.array_equal(images[0], images[1])
    assert np.array_equal(images[0], images[2])


@needs_core
@pytest.mark.parametrize("probe", [LINEAR, CURVED, Probe.phased(depth_mm=100, lines=128)], ids=lambda p: p.kind)
def test_every_instruction_set_agrees_with_the_twin(probe, native, monkeypatch):
    field, needle = a_field(), ss.Needle((40, 15, 10), (75, 16, 40))

    def image(back_end):
        monkeypatch.setattr(_core, "active", back_end)
        return liver_scanner(probe).render(field, needle, frame=1)

    expected = image(_core.twin)
    weight = 1 / np.sqrt(expected.optics.speckle_power)
    rms = np.sqrt(np.mean(np.abs(expected.iq * weight) ** 2))
    for name in INSTRUCTION_SETS:
        native.use_instruction_set(name)
        found = image(native)
        assert np.sqrt(np.mean(np.abs((found.iq - expected.iq) * weight) ** 2)) < 1e-4 * rms
        assert np.abs(found.beams.astype(int) - expected.beams).max() <= 1
        assert np.abs(found.frame.pixels.astype(int) - expected.frame.pixels).max() <= 2


@pytest.mark.slow
@needs_core
@pytest.mark.parametrize("probe", [LINEAR, CURVED, Probe.phased(depth_mm=100, lines=128)], ids=lambda p: p.kind)
def test_every_instruction_set_chooses_the_scatterers_of_the_twin(probe, native, monkeypatch):
    """In a phantom with textures and interfaces, seen obliquely, over a lattice turned against it."""
    voxels = np.zeros((70, 30, 60), np.uint8)
    voxels[:, :, 20:40], voxels[30:, :, 40:] = 1, 2
    phantom = Phantom(Volume(voxels=voxels, spacing=(1, 1.2, 1.1)), {0: "liver", 1: "muscle", 2: "urine"})
    pose = facing((35, 18, 1), depth=(0.2, 0.1, 1), right=(1, 0.3, 0))
    turn = facing((0, 0, 0), depth=(0.1, 1, 0), right=(1, 0, 0.2))[:3, :3]
    grid = ss.Grid(shape=(20, 9, 18), spacing=(3, 4, 3.5), origin=(5, -2, 3), direction=turn)

    def chosen():
        frames, nodes, starts, place, amplitude, step = aim(phantom, Optics(probe), pose, grid, 3.0, 5)[:6]
        cell = np.repeat(np.arange(len(nodes)), np.diff(starts))
        each = [nodes[cell, :1], frames[cell][:, :14], place[:, : len(cell)].T / 65536, amplitude[: len(cell)] * step]
        table = np.column_stack(each)
        return table[np.lexsort(np.round(table[:, [0, 15, 16, 17]], 3).T)]

    monkeypatch.setattr(_core, "active", _core.twin)
    expected = chosen()
    monkeypatch.setattr(_core, "active", native)
    for name in INSTRUCTION_SETS:
        native.use_instruction_set(name)
        found = chosen()
        assert found.shape == expected.shape
        assert len(found) > 20_000
        assert np.mean(np.abs(found - expected).max(axis=1) > 1e-4) < 1e-3


def test_a_moved_probe_shows_what_a_new_one_would():
    scanner = liver_scanner(CURVED)
    before = scanner.render(a_field()).iq
    pose = facing((72, 14, 5), depth=(0.1, 0.05, 1), right=(1, 0, 0))
    moved = scanner.moved(pose)
    new = Scanner(scanner.phantom, CURVED, pose, display=FLAT, margin_mm=0.2)
    assert np.array_equal(moved.render(a_field()).iq, new.render(a_field()).iq)
    assert np.allclose(moved.probe_to_reference, pose)
    assert np.array_equal(scanner.render(a_field()).iq, before)


@pytest.mark.slow
def test_another_setting_of_the_probe_shows_what_a_new_scanner_would():
    scanner = liver_scanner(CURVED)
    before = scanner.render(a_field()).iq
    for probe in (replace(CURVED, depth_mm=80, frequency_mhz=4.5, elevation_focus_mm=40), LINEAR):
        other = scanner.with_probe(probe)
        new = Scanner(
            scanner.phantom, probe, scanner.probe_to_reference, display=FLAT, margin_mm=0.2,
            picture_shape=scanner.plane.shape,
        )  # fmt: skip
        found, expected = other.render(a_field()), new.render(a_field())
        assert np.array_equal(found.iq, expected.iq)
        assert np.array_equal(found.frame.pixels, expected.frame.pixels)
        assert np.array_equal(found.frame.mask, expected.frame.mask)
    assert np.array_equal(scanner.render(a_field()).iq, before)
    with pytest.raises(ValueError, match="probe = 'linear'"):
        scanner.with_probe("linear")


def test_a_field_on_a_lattice_of_its_own_is_sampled_on_its_grid():
    field = a_field()
    coarse = ss.Grid.covering((140, 30, 108), nodes=2000)
    other = ss.GridField(field.grid, field.displacement(coarse.points).reshape(*coarse.shape, 3), lattice=coarse)
    at_nodes = ss.GridField(field.grid, other.on_grid())
    scanner = liver_scanner(LINEAR)
    assert np.array_equal(scanner.render(other).iq, scanner.render(at_nodes).iq)


def test_a_probe_that_sees_nothing_gives_a_black_picture_and_a_warning(caplog):
    phantom = Phantom.uniform("liver", size_mm=(30, 10, 30))
    away = Scanner(phantom, LINEAR, facing((500, 0, 0), depth=(0, 0, 1), right=(1, 0, 0)))
    with caplog.at_level(logging.WARNING):
        image = away.render()
        for x in (510, 600):
            away = away.moved(facing((x, 0, 0), depth=(0, 0, 1), right=(1, 0, 0)))
            away.render()
            away.render()
    assert caplog.text.count("sees nothing") == 1
    assert image.frame.pixels.mean() < 5


def test_a_field_with_nan_is_left_out_with_a_warning(caplog):
    scanner, field = liver_scanner(LINEAR), a_field()
    values = field.values.copy()
    values[3, 3, 3] = np.nan
    with caplog.at_level(logging.WARNING):
        image = scanner.render(ss.GridField(field.grid, values))
    assert "NaN" in caplog.text
    assert np.array_equal(image.iq, scanner.render().iq)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None, LINEAR, np.eye(4)), "phantom = None"),
        (("scene", None, np.eye(4)), "probe = None"),
        (("scene", LINEAR, np.zeros((4, 4))), "not rigid"),
    ],
)
def test_what_is_no_scanner_is_refused(arguments, message):
    phantom = Phantom.uniform("liver", size_mm=(30, 10, 30)) if arguments[0] else None
    with pytest.raises(ValueError, match=message):
        Scanner(phantom, *arguments[1:])


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


def test_an_image_that_fails_leaves_no_trace_in_the_next(monkeypatch):
    """Scatterers are chosen anew for a large displacement; where that fails, they are the next time."""

    def pushed(mm):
        values = np.zeros((*grid.shape, 3), np.float32)
        values[..., 1] = mm
        return ss.GridField(grid, values)

    phantom, grid = Phantom.uniform("liver", size_mm=(40, 30, 40)), ss.Grid(shape=(9, 7, 9), spacing=5.0)
    scanner = Scanner(phantom, LINEAR, facing((20, 15, 2), depth=(0, 0, 1), right=(1, 0, 0)), margin_mm=2.0)
    fresh = Scanner(phantom, LINEAR, scanner.probe_to_reference, margin_mm=2.0)
    scanner.render(pushed(1.0))
    with monkeypatch.context() as broken:
        broken.setattr("sonospline.ultrasound.aimed.aim", lambda *_, **__: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            scanner.render(pushed(9.0))
    assert np.array_equal(scanner.render(pushed(9.0)).iq, fresh.render(pushed(9.0)).iq)
    assert np.array_equal(scanner.render(pushed(1.0)).iq, fresh.render(pushed(1.0)).iq)
