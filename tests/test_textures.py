"""Textures of tissue: kinds, directions, and that they belong to the tissue."""

from dataclasses import replace

import numpy as np
import pytest

from builds import needs_core
from sonospline import _core
from sonospline._core import twin
from sonospline._core.textures import KINDS, texture_map, textures
from sonospline.fields import GridField
from sonospline.geometry import Grid, facing
from sonospline.ultrasound import TISSUES, Phantom, Probe, Scanner
from sonospline.ultrasound.acoustics import read_table, textured, write_table

POSE = facing((15, 6, 0), depth=(0, 0, 1), right=(1, 0, 0))
PROBE = Probe.linear(frequency_mhz=5, depth_mm=28, aperture_mm=28, lines=64, samples=512, elevation_focus_mm=14)


def image(tissue, **seen):
    return Scanner(Phantom.uniform(tissue, size_mm=(30, 12, 30)), PROBE, POSE).render(**seen)


def fibres(direction):
    return replace(
        textured(TISSUES["liver"], direction), texture="fibres", texture_db=6.0, texture_mm=(40.0, 40.0, 2.5)
    )


def test_every_kind_has_mean_zero_deviation_one_and_a_period():
    volumes = textures(len(KINDS))
    assert volumes.shape[0] == len(KINDS) == 4
    assert np.allclose(volumes.mean(axis=(1, 2, 3)), 0, atol=1e-4) and np.allclose(volumes.std(axis=(1, 2, 3)), 1)
    for volume in volumes:
        seam, inside = np.abs(volume[0] - volume[-1]).mean(), np.abs(volume[1:] - volume[:-1]).mean()
        assert seam < 1.3 * inside


def test_the_default_direction_scales_each_axis_and_no_more():
    """To the bit: what has no direction of its own is as it was."""
    assert np.array_equal(texture_map((1.0, 0.0, 0.0), (12.0, 6.0, 1.0)), np.diag(3 / np.array((12.0, 6.0, 1.0))))


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 1, 0), (1, 2, -3), (0, 0, -5)])
def test_lengths_are_along_and_across_the_direction(direction):
    found = texture_map(direction, (10.0, 2.0, 2.0))
    along = np.array(direction) / np.linalg.norm(direction)
    assert np.allclose(found @ along, (3 / 10, 0, 0))
    assert np.allclose(found @ found.T, np.diag([3 / 10, 3 / 2, 3 / 2]) ** 2)


def spread(beams, axis):
    """Of levels averaged along an axis of the beams, over speckle's own."""
    return float(beams[8:-8, 120:400].astype(float).mean(axis=axis).std())


def test_fibres_run_where_they_are_said_to():
    along, down = image(fibres((1, 0, 0))), image(fibres((0, 0, 1)))
    assert spread(along.beams, 0) > 2 * spread(image(TISSUES["liver"]).beams, 0)  # layers: rows differ
    assert spread(along.beams, 0) > 1.5 * spread(down.beams, 0)
    assert spread(down.beams, 1) > 1.5 * spread(along.beams, 1)


def test_texture_moves_with_its_tissue():
    grid = Grid.covering((30, 12, 30), nodes=2000)
    moved = np.zeros((*grid.shape, 3), np.float32)
    moved[..., 2] = 2.0
    rows = [
        shown.envelope[8:-8, 100:400].mean(axis=0)
        for shown in (image(fibres((1, 0, 0))), image(fibres((1, 0, 0)), deformed=GridField(grid, moved)))
    ]
    shifts = np.arange(-60, 61)
    match = [np.corrcoef(rows[0][70:-70], np.roll(rows[1], -s)[70:-70])[0, 1] for s in shifts]
    assert shifts[int(np.argmax(match))] * PROBE.sample_mm == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("name", ["muscle", "fat", "liver", "kidney cortex", "spleen"])
def test_textures_leave_the_mean_level_about_where_it_was(name):
    plain, rich = image(replace(TISSUES[name], texture_db=0.0)), image(textured(TISSUES[name]))
    change = 10 * np.log10((rich.envelope[8:-8] ** 2).mean() / (plain.envelope[8:-8] ** 2).mean())
    assert abs(change) < 2.5


@needs_core
def test_the_core_and_its_twin_choose_the_same(monkeypatch):
    tissue = replace(textured(TISSUES["liver"]), texture_direction=(0.3, -0.5, 0.8), texture_db=4.0)
    small = replace(PROBE, depth_mm=14, samples=256, aperture_mm=10, lines=24)
    seen = []
    for backend in (_core.active, twin):
        monkeypatch.setattr(_core, "active", backend)
        phantom = Phantom.uniform(tissue, size_mm=(30, 12, 20))
        seen.append(Scanner(phantom, small, POSE).render().iq)
    error = np.sqrt(np.mean(np.abs(seen[0] - seen[1]) ** 2) / np.mean(np.abs(seen[0]) ** 2))
    assert error < 1e-4


def test_a_phantom_is_textured_by_the_names_of_its_tissues():
    phantom = Phantom(Phantom.uniform("gel", size_mm=(4, 4, 4)).labels, {0: "gel", 1: "muscle", 2: "liver"})
    rich = phantom.textured()
    assert [rich.tissues[k].texture for k in range(3)] == ["blobs", "fibres", "triads"]
    assert rich.tissues[0] == phantom.tissues[0]


def test_a_saved_phantom_keeps_its_textures_roughness_and_walls(tmp_path):
    pytest.importorskip("SimpleITK")
    oblique = replace(textured(TISSUES["liver"], (0.1, -0.7, 1 / 3)), roughness_db=-12.0, wall_mm=0.6)
    phantom = Phantom(Phantom.uniform("gel", size_mm=(4, 4, 4)).labels, {0: oblique, 1: "muscle"}).textured()
    phantom.save(tmp_path / "labels.nrrd", tmp_path / "tissues.csv")
    assert read_table(tmp_path / "tissues.csv") == phantom.tissues


def test_a_table_need_not_say_textures_and_says_three_numbers_where_it_does(tmp_path):
    write_table(tmp_path / "whole.csv", [(0, TISSUES["kidney medulla"])])
    plain = [line.rsplit(",", 5)[0] for line in (tmp_path / "whole.csv").read_text().splitlines()]
    (tmp_path / "plain.csv").write_text("\n".join(plain))
    assert read_table(tmp_path / "plain.csv") == {0: TISSUES["kidney medulla"]}
    (tmp_path / "two.csv").write_text((tmp_path / "whole.csv").read_text().replace("3.0 3.0 3.0", "3.0 3.0"))
    with pytest.raises(ValueError, match=r"line 2: texture_mm = .*give three numbers"):
        read_table(tmp_path / "two.csv")


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"texture_direction": (0, 0, 0)}, "texture_direction = .* has length zero"),
        ({"texture_direction": (0, 1)}, "give three numbers"),
        ({"texture_direction": (0, float("nan"), 1)}, "give three numbers"),
        ({"texture": "zebra"}, "texture = 'zebra'"),
        ({"texture_mm": (3, 0, 3)}, r"texture_mm\[1\]"),
    ],
)
def test_textures_that_cannot_be(changes, said):
    with pytest.raises(ValueError, match=said):
        replace(TISSUES["muscle"], **changes)
