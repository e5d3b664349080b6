"""The kidney scene's needle meets the forces of human cadavers, and one that does not remember those it did."""

import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

import sonospline as ss
from sonospline.contact import Medium
from sonospline.elasticity import ElasticSolver
from sonospline.io.toml_text import loads
from sonospline.mechanics import Material, MaterialTable
from sonospline.simulator import make_scene
from sonospline.study.renal_access import PEAK_N, SPREAD, draw_passes, layers_along, predicted, pushed

TABLES = {
    "sonospline.mechanics": "assumed_materials.toml",
    "sonospline.simulator": "scenes/materials.toml",
}
PUBLISHED = re.compile(r"10\.\d{4,}/\S+|PMC\d+|\d{4};\d+")
"""A DOI, a number of PubMed Central, or a year and volume."""


@pytest.fixture(scope="module")
def kidney():
    return make_scene("kidney")


def drawn(kidney, count, seed=0, tissues=None, **spread):
    tissues = kidney.tissues if tissues is None else tissues
    passes = draw_passes(tissues, kidney.targets["lower calyx"], count, seed, {**SPREAD, **spread})
    return [predicted(tissues, one) for one in passes]


def share(readings):
    return np.mean([reading.inside for reading in readings], axis=0)


def without_fit(tissues):
    """The tissues as the pose's model knows them."""
    own = {label: replace(material, track_friction_n_per_mm=None) for label, material in tissues.materials.items()}
    return replace(tissues, materials=own)


@pytest.mark.slow
def test_nine_in_ten_of_a_thousand_needles_are_those_of_cadavers(kidney):
    """Whichever way the slope is read."""
    from_puncture, overall = share(drawn(kidney, 1000))
    assert from_puncture >= 0.9
    assert overall >= 0.9


def test_most_needles_are_those_of_cadavers_and_few_were_without_the_fit(kidney):
    assert share(drawn(kidney, 80)).min() > 0.82
    assert share(drawn(kidney, 80, tissues=without_fit(kidney.tissues))).max() < 0.15


def test_the_more_tissues_vary_the_fewer_are_inside(kidney):
    shares = [share(drawn(kidney, 60, **dict.fromkeys(SPREAD, sd))) for sd in (0.05, 0.2, 0.5)]
    assert (shares[0] > shares[1]).all()
    assert (shares[1] > shares[2]).all()


def test_draws_are_those_of_their_seed(kidney):
    assert drawn(kidney, 3) == drawn(kidney, 3)
    assert drawn(kidney, 3) != drawn(kidney, 3, seed=1)


def test_ways_meet_skin_and_capsule_and_end_in_the_calyx(kidney):
    for one in draw_passes(kidney.tissues, kidney.targets["lower calyx"], 20, 0, SPREAD):
        layers = layers_along(kidney.tissues, one)
        assert [layer.begin_mm for layer in layers] == sorted(layer.begin_mm for layer in layers)
        assert PEAK_N[0] <= layers[0].rupture_force_n <= PEAK_N[1]
        assert next(layer for layer in layers if layer.tissue.startswith("kidney")).rupture_force_n > 0.5
        assert layers[-1].tissue in ("urine", "sinus fat")  # what is aimed at varies
        assert "bone" not in {layer.tissue for layer in layers}
        assert 65 <= one.needle.depth <= 129


@pytest.mark.slow
def test_the_closed_form_is_what_the_live_tissue_says(kidney):
    """Of needles in elastic tissue that leave tracks."""
    for one in draw_passes(kidney.tissues, kidney.targets["lower calyx"], 2, 7, SPREAD):
        live, closed = pushed(kidney, one), predicted(kidney.tissues, one)
        assert live.peak_n == pytest.approx(closed.peak_n, rel=1e-6)
        assert live.slope_n_cm == pytest.approx(closed.slope_n_cm, rel=0.15)
        assert live.overall_n_cm == pytest.approx(closed.overall_n_cm, rel=0.2)


def test_only_tracks_meet_the_fitted_friction(kidney):
    tissues, places = kidney.tissues, np.random.default_rng(0).uniform(0, 100, (200, 3))
    for now, then in zip(tissues.resistance(places), without_fit(tissues).resistance(places), strict=True):
        np.testing.assert_array_equal(now, then)
    box = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5))
    for friction, met in ((None, 30.0), (0.05, 50.0), (0.0, 0.0)):
        solver = ElasticSolver(box, Material(10.0, track_friction_n_per_mm=friction), nodes=9**3)
        assert Medium(solver, width=10.0).resistance(np.full((1, 3), 50.0)).friction == pytest.approx(met)


def test_a_fitted_friction_is_a_number_at_or_above_zero():
    with pytest.raises(ValueError, match=r"track_friction_n_per_mm = -0.1 is out of range"):
        Material(track_friction_n_per_mm=-0.1)


@pytest.mark.parametrize("package", TABLES)
def test_every_row_of_a_table_has_a_source_or_says_assumed(package):
    table = loads(files(package).joinpath(TABLES[package]).read_text())
    for name, row in table.items():
        assert "source" in row, f"[{name}] does not say where its values come from"
        assert row["source"].startswith("assumed") or PUBLISHED.search(row["source"]), name
        if "track_friction_n_per_mm" in row:
            assert PUBLISHED.search(row["source"]), name
    assert len(table) > 8


def test_the_whole_table_says_so_where_it_is_read(kidney):
    for material in [*MaterialTable.assumed().materials.values(), *kidney.tissues.materials.values()]:
        assert material.source.startswith("assumed") or PUBLISHED.search(material.source)


def test_membranes_say_where_their_forces_come_from(kidney):
    source = {membrane.name: membrane.source for membrane in kidney.tissues.membranes}
    assert PUBLISHED.search(source.pop("skin"))
    assert set(source.values()) == {"assumed"}
