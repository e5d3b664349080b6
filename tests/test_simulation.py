"""From labels to forces and a picture, in the few lines that the README shows."""

from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from sonospline import models
from sonospline.io.volumes import write_volume

ENTRY, TARGET = (0, 24, 24), (30, 24, 24)
NAMES = {1: "skin", 2: "liver", 3: "tumour"}


@pytest.fixture(scope="module")
def organs():
    """A block of 48 mm: skin, liver with a tumour."""
    voxels = np.full((25, 25, 25), 2, np.uint8)
    voxels[:2] = 1
    voxels[14:18, 10:14, 10:14] = 3
    return ss.LabelMap(voxels=voxels, spacing=(2, 2, 2), names=NAMES)


@pytest.fixture(scope="module")
def elastic(organs):
    return ss.Simulation(organs, model="elastic", entry_face="x-", nodes=8000, solver_nodes=13**3)


@pytest.fixture
def pose():
    return ss.facing((15, 24, 0.5), depth=(0, 0, 1), right=(1, 0, 0))


# --- labels with names ---


@pytest.mark.parametrize("names", [None, "given.csv", NAMES], ids=["beside", "file", "mapping"])
def test_labels_carry_their_names(organs, names, tmp_path):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    write_volume(organs, tmp_path / "organs.nii.gz")
    table = "label,name\n" + "".join(f"{label},{name}\n" for label, name in NAMES.items())
    (tmp_path / ("organs.csv" if names is None else "given.csv")).write_text(table)
    labels = ss.read_labels(tmp_path / "organs.nii.gz", names=tmp_path / names if isinstance(names, str) else names)
    assert labels.names == NAMES
    assert repr(labels) == "LabelMap(25 x 25 x 25, 2.0 mm, 3 labels with names)"


def test_labels_without_a_table_have_no_names_and_are_read(organs, tmp_path, caplog):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    write_volume(organs, tmp_path / "organs.nrrd")
    assert ss.read_labels(tmp_path / "organs.nrrd").names == {}
    assert not caplog.messages
    (tmp_path / "organs.csv").write_text("volume,mean\n1,2\n")  # of something else
    assert ss.read_labels(tmp_path / "organs.nrrd").names == {}
    assert len(caplog.messages) == 1
    assert "lacks the column" in caplog.messages[0]
    with pytest.raises(ValueError, match="lacks the column 'label'"):
        ss.read_labels(tmp_path / "organs.nrrd", names=tmp_path / "organs.csv")


# --- insertions ---


def test_an_insertion_gives_a_field_and_forces(elastic):
    response = elastic.insert(ENTRY, TARGET, steps=4)
    assert response.settled
    assert response.error_estimate <= 1.5e-3  # of the iteration and of where the load acts together
    skin, liver, tumour = (ss.MaterialTable.assumed()[name] for name in NAMES.values())
    friction = 3 * skin.friction_n_per_mm + 24 * liver.friction_n_per_mm + 3 * tumour.friction_n_per_mm
    pushed = response.forces["needle"].axial_n - friction  # the tumour gives way: the bevel is in either, or both
    assert 0.9 * liver.cutting_force_n < pushed < 1.02 * tumour.cutting_force_n
    assert response.field.displacement(TARGET)[0] > 0.05
    assert elastic.response is response


def test_a_needle_says_both_its_entry_and_its_target(elastic):
    by_points = elastic.insert(ENTRY, TARGET, steps=3)
    assert elastic.insert(ss.Needle(ENTRY, TARGET), steps=3).state == by_points.state
    for wrong in ((ENTRY,), (ss.Needle(ENTRY, TARGET), TARGET)):
        with pytest.raises(ValueError, match="target goes with an entry point; give both, or one Needle"):
            elastic.insert(*wrong)


def test_an_insertion_starts_from_rest_and_gives_the_same_bits_again(elastic):
    first = elastic.insert(ENTRY, TARGET, steps=3)
    elastic.step({"needle": ss.Needle(ENTRY, (20, 30, 20))})
    again = elastic.insert(ENTRY, TARGET, steps=3)
    assert again.state == first.state
    assert np.array_equal(again.field.on_grid(), first.field.on_grid())


def test_progress_is_calls_step_by_step(elastic):
    calls = []
    elastic.insert(ENTRY, TARGET, steps=3, progress=lambda made, steps: calls.append((made, steps)))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    depths = [dict(r.state.needles)["needle"].depth for r in elastic.run(ENTRY, TARGET, steps=3)]
    assert depths == pytest.approx([10, 20, 30])


def test_a_step_that_fails_leaves_the_last_response(elastic):
    before = elastic.insert(ENTRY, TARGET, steps=2)
    for wrong in ({"needle": ss.Needle(ENTRY, (500, 24, 24))}, "needle", {"a": ss.Needle(ENTRY, TARGET), "b": 5}):
        with pytest.raises(ValueError, match=r"outside the tissue|needles"):
            elastic.step(wrong)
    with pytest.raises(ValueError, match="dt"):
        elastic.step({}, dt=-1)
    assert elastic.response is before


@pytest.mark.parametrize("model", ["paper", "kelvinlet", "elastic"])
@pytest.mark.parametrize("what", ["grid", "tissue"])
def test_a_box_needs_no_labels(model, what):
    grid = ss.Grid(shape=(13, 13, 13), spacing=4)
    options = {"solver_nodes": 13**3} if model == "elastic" else {}
    given = grid if what == "grid" else ss.Tissue(grid, "x-")
    response = ss.Simulation(given, model=model, **options).insert(ENTRY, TARGET, steps=2)
    assert response.field.on_grid().shape == (13, 13, 13, 3)
    assert response.field.displacement((28, 24, 24))[0] > 0.05
    assert ("needle" in response.forces) == (model == "elastic")


@pytest.mark.slow
def test_materials_change_the_answer(organs, elastic, tmp_path):
    (tmp_path / "mine.toml").write_text("[liver]\nstiffness_kpa = 60\n")
    stiff = {"liver": ss.Material(stiffness_kpa=60)}
    soft = elastic.insert(ENTRY, TARGET, steps=2).field.displacement(TARGET)[0]
    tables = (tmp_path / "mine.toml", str(tmp_path / "mine.toml"), stiff, ss.MaterialTable.assumed().preferring(stiff))
    found = [
        ss.Simulation(organs, nodes=8000, solver_nodes=13**3, materials=table)
        .insert(ENTRY, TARGET, steps=2)
        .field.displacement(TARGET)[0]
        for table in tables
    ]
    assert found == pytest.approx([found[0]] * 4, rel=0.02)
    assert found[0] < 0.5 * soft


def test_what_cannot_be_simulated_is_said_in_one_line(organs):
    nameless = organs.named({})
    for make, message in (
        (lambda: ss.Simulation(nameless), r"has no names; read it with them"),
        (lambda: ss.Simulation(organs.named({1: "skin"})), r"labels \[2, 3\] have no name"),
        (lambda: ss.Simulation(organs.named(NAMES | {3: "widget"})), "'widget' has no material"),
        (lambda: ss.Simulation(organs, model="paper"), "cannot do labels"),
        (lambda: ss.Simulation(organs, model="magic"), "model = 'magic' is not known; choose one of"),
        (lambda: ss.Simulation(organs, entry_face="up"), "entry_face = 'up' is not known"),
        (lambda: ss.Simulation(organs, materials=ss.Material(5)), "for a box of one tissue"),
        (lambda: ss.Simulation(ss.Grid.unit_cube(5), materials={"liver": 5}), "is for labels"),
        (lambda: ss.Simulation(np.zeros((5, 5, 5))), "tissue = .* is none; give labels"),
        (lambda: ss.Simulation(organs, wonder=3), "wonder is no option of model = 'elastic'"),
    ):
        with pytest.raises(ValueError, match=message) as error:
            make()
        assert len(str(error.value).splitlines()) == 1
        assert len(str(error.value)) < 400


# --- pictures of it ---


def test_the_scanner_takes_labels_with_names_and_what_was_inserted(organs, elastic, pose, tmp_path):
    probe = ss.Probe.linear(depth_mm=40, lines=64)
    scanner = ss.Scanner(organs, probe, probe_to_reference=pose)
    response = elastic.insert(ENTRY, TARGET, steps=3)
    image = scanner.render(response)
    needle = dict(response.state.needles)["needle"]
    assert np.array_equal(image.pixels, scanner.render(response.field, needle).pixels)
    assert (image.pixels != scanner.render(response.field).pixels).any()  # the needle is in it
    assert (image.pixels != scanner.render().pixels).mean() > 0.05
    image.save(tmp_path / "b.png")
    assert (tmp_path / "b.png").read_bytes().startswith(b"\x89PNG")


def test_labels_and_tissues_are_what_a_phantom_of_them_is(organs, pose):
    tissues = {0: "gel", 1: "skin", 2: "liver", 3: ss.AcousticTissue(
        name="cyst", speed_m_s=1500, density_kg_m3=1000, attenuation_db_cm_mhz=0.02, backscatter_db=-200,
    )}  # fmt: skip
    probe = ss.Probe.linear(depth_mm=40, lines=64)
    by_labels = ss.Scanner(organs, probe, pose, tissues=tissues).render()
    by_phantom = ss.Scanner(ss.Phantom(organs, tissues), probe, pose).render()
    assert np.array_equal(by_labels.pixels, by_phantom.pixels)


def test_several_needles_are_all_in_the_picture(organs, elastic, pose):
    scanner = ss.Scanner(organs, ss.Probe.linear(depth_mm=40, lines=64), pose)
    needles = {"a": ss.Needle((0, 24, 12), (28, 24, 12)), "b": ss.Needle((0, 24, 30), (20, 24, 30))}
    elastic.reset()
    both = scanner.render(elastic.step(needles)).pixels.astype(int)
    field = elastic.response.field
    none = scanner.render(field).pixels.astype(int)
    for needle in needles.values():
        alone = scanner.render(field, needle).pixels.astype(int)
        bright = alone - none > 60
        assert bright.sum() > 100
        assert (both - none)[bright].mean() > 0.6 * (alone - none)[bright].mean()


def test_what_cannot_be_imaged_is_said_in_one_line(organs, pose):
    probe = ss.Probe.linear(depth_mm=40, lines=64)
    for make, message in (
        (lambda: ss.Scanner(organs.named({}), probe, pose), "has no names; read it with them, or give tissues"),
        (lambda: ss.Scanner(organs.named(NAMES | {3: "widget"}), probe, pose), "organ 'widget' has no acoustic"),
        (lambda: ss.Scanner(organs.named({1: "skin"}), probe, pose), "label 2 has no name"),
        (lambda: ss.Scanner(np.zeros((5, 5, 5)), probe, pose), "phantom = .* is none; give a Phantom, or labels"),
        (lambda: ss.Scanner(organs, "linear", pose), "probe = 'linear' is not a Probe"),
        (lambda: ss.Scanner(organs, probe, pose).render(np.zeros(3)), "deformed = .* is no Field and no Response"),
    ):
        with pytest.raises(ValueError, match=message) as error:
            make()
        assert len(str(error.value).splitlines()) == 1
        assert len(str(error.value)) < 400


@pytest.mark.slow
def test_a_real_patient_from_file_to_picture(shared_data):
    labels = ss.read_labels(shared_data / "abdomen_labels.nii.gz")
    assert "liver" in labels.names.values()
    sim = ss.Simulation(labels, model="elastic", entry_face="y+", nodes=60_000)
    target = labels.position(np.argwhere(labels.voxels == 2).mean(axis=0))
    box = sim.tissue.grid
    inside = box.local(target)
    inside[1] = box.extent[1]
    entry = box.world(inside)
    response = sim.insert(entry, target, steps=5)
    assert response.settled
    assert response.forces["needle"].axial_n > 0.5
    probe_to_reference = ss.facing(target - [0, -60, 0], depth=(0, -1, 0), right=(1, 0, 0))
    image = ss.Scanner(labels, ss.Probe.curvilinear(), probe_to_reference).render(response)
    assert image.pixels[image.frame.mask].std() > 10


def test_models_are_made_by_the_table(organs):
    sim = ss.Simulation(organs, nodes=2000, solver_nodes=13**3)
    assert sim.model.name in models.names()
    assert repr(sim).startswith("Simulation(elastic, Tissue(")
    assert replace(sim.response).settled
