"""Whole insertions by finite elements, and the cache they are kept in."""

import logging
import re
from pathlib import Path

import numpy as np
import pytest

import sonospline as ss
from elastic_problems import largest_difference
from sonospline.fem import FiniteElementModel, history, reference_history
from sonospline.mechanics import LineForce, Material, Moduli, ShaftDisplacement

pytest.importorskip("skfem", reason="needs the extra 'fem'")
pytest.importorskip("pyamg", reason="needs the extra 'fem'")


@pytest.fixture(autouse=True)
def a_cache_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_each_step_of_a_history_is_the_field_at_its_depth(small_tissue):
    entry, target = np.array([0, 0.5, 0.5]), np.array([0.6, 0.45, 0.55])
    reported = []
    fields = reference_history(
        small_tissue, entry, target, steps=4, progress=lambda done, of: reported.append((done, of))
    )
    assert fields.shape == (4, 9, 9, 9, 3)
    assert reported == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    model = FiniteElementModel(small_tissue)
    for step in (1, 3):
        needle = ss.Needle(entry, entry + (step + 1) / 4 * (target - entry))
        assert largest_difference(fields[step], model.solve(LineForce(), needle)) < 1e-9
    held = reference_history(small_tissue, entry, target, 2, ShaftDisplacement(radius=0.1), Material(2.0, 0.3))
    assert np.abs(held).max() == pytest.approx(0.0266, rel=0.2)


def refuse(*_, **__):
    raise AssertionError("solved although it was on disk")


def test_a_history_is_kept_by_everything_it_depends_on(small_tissue, a_cache_of_its_own, monkeypatch):
    path = ((0, 0.5, 0.5), (0.6, 0.5, 0.5))
    first = reference_history(small_tissue, *path, steps=2)
    assert len(list(a_cache_of_its_own.iterdir())) == 1
    monkeypatch.setattr(FiniteElementModel, "solve", refuse)
    reported = []
    again = reference_history(small_tissue, *path, steps=2, progress=lambda *state: reported.append(state))
    assert np.array_equal(first, again)
    assert reported == [(2, 2)]
    others = [
        {"steps": 3},
        {"load": LineForce(friction=0.02)},
        {"load": ShaftDisplacement(radius=0.1)},
        {"material": Material(poissons_ratio=0.4)},
        {"material": Moduli(ss.Grid.unit_cube(9), np.full((8, 8, 8), 3.1), np.full((8, 8, 8), 0.34))},
        {"element": "tetrahedron"},
        {"integration": "mean_dilatation"},
    ]
    for other in others:
        with pytest.raises(AssertionError, match="although"):
            reference_history(small_tissue, *path, **{"steps": 2, **other})
    for tissue in (ss.Tissue(small_tissue.grid, entry_face="x+"), ss.Tissue(ss.Grid.unit_cube(8))):
        with pytest.raises(AssertionError, match="although"):
            reference_history(tissue, *path, steps=2)


def other_version(file, monkeypatch):
    monkeypatch.setattr(history, "_VERSION", history._VERSION + 1)


def cut_short(file, _):
    file.write_bytes(file.read_bytes()[:-50])


def flipped_bits(file, _):
    spoilt = bytearray(file.read_bytes())
    spoilt[len(spoilt) // 2] ^= 255
    file.write_bytes(spoilt)


def other_shape(file, _):
    np.savez(file, version=history._VERSION, history=np.zeros((2, 3)))


def emptied(file, _):
    file.write_bytes(b"")


@pytest.mark.parametrize("spoil", [other_version, cut_short, flipped_bits, other_shape, emptied])
def test_a_damaged_or_other_history_is_said_and_made_anew(small_tissue, a_cache_of_its_own, monkeypatch, caplog, spoil):
    path = ((0, 0.5, 0.5), (0.6, 0.5, 0.5))
    first = reference_history(small_tissue, *path, steps=1)
    (file,) = a_cache_of_its_own.iterdir()
    spoil(file, monkeypatch)
    with caplog.at_level(logging.WARNING, logger="sonospline"):
        second = reference_history(small_tissue, *path, steps=1)
    assert np.array_equal(first, second)
    assert "cannot be used and will be made anew" in caplog.text
    monkeypatch.setattr(FiniteElementModel, "solve", refuse)
    assert np.array_equal(reference_history(small_tissue, *path, steps=1), first)


def test_the_example_in_the_docs_runs():
    page = (Path(__file__).parents[1] / "docs" / "fem.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names = {}
    exec(example, names)
    assert names["steps"].shape == (4, 13, 13, 13, 3)
    assert largest_difference(names["steps"][-1], names["u"]) < 1e-9
