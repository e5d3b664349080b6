"""Label maps and tables of materials: what a cell is made of, and what is refused."""

from dataclasses import field, fields, make_dataclass

import numpy as np
import pytest

import sonospline as ss
from sonospline.elasticity import ElasticSolver
from sonospline.fields import Strain, largest_strain
from sonospline.geometry.volume import Volume
from sonospline.mechanics import (
    FLUID_SHEAR,
    Material,
    MaterialTable,
    TissueMap,
    labelled_cube,
    material_table,
    read_label_names,
)
from sonospline.mechanics.material import parameters
from sonospline.mechanics.mixture import mixing_shares

SOFT, STIFF = Material(stiffness_kpa=1), Material(stiffness_kpa=16)
BONE = Material(stiffness_kpa=1000, rigid=True)


def halves(fraction, low, high, voxels=64, axis=0):
    """A unit cube of two materials that meet at a fraction of its side."""
    labels = np.zeros((voxels,) * 3, np.int16)
    np.moveaxis(labels, axis, 0)[round(fraction * voxels) :] = 7
    volume = Volume(voxels=labels, spacing=(1 / voxels,) * 3, origin=(0.5 / voxels,) * 3)
    return TissueMap(volume, {0: low, 7: high})


def shear_along(tissues, nodes=5):
    return tissues.moduli(ss.Grid.unit_cube(nodes)).shear[:, 1, 1]


def test_a_mixed_cell_is_the_geometric_mean_of_what_it_holds():
    soft, stiff = SOFT.lame_moduli[1], STIFF.lame_moduli[1]
    fifth = shear_along(halves(0.25 + 1 / 20, SOFT, STIFF, voxels=80))  # of the second cell is soft
    np.testing.assert_allclose(fifth, [soft, soft**0.2 * stiff**0.8, stiff, stiff], rtol=1e-6)


@pytest.mark.parametrize("hard", [Material(stiffness_kpa=101), Material(stiffness_kpa=1e6)])
@pytest.mark.parametrize(("soft_part", "takes_it"), [(1 / 4, True), (3 / 4, False)])
def test_what_is_a_hundred_times_as_stiff_takes_a_cell_by_majority(hard, soft_part, takes_it):
    second = shear_along(halves(0.25 + 0.25 * soft_part, SOFT, hard))[1]
    assert second == pytest.approx((hard if takes_it else SOFT).lame_moduli[1])


def test_of_three_tissues_those_mix_that_are_near():
    """Fat and muscle of a cell of which a fluid, or bone, has the smaller part."""
    shares = mixing_shares(np.array([[1e-3, 1.0], [1.0, 90.0], [30.0, 90.0], [900.0, 2e4]]))
    np.testing.assert_allclose(shares, [[0, 1 / 3], [1 / 3, 1 / 3], [1 / 3, 1 / 3], [1 / 3, 0]])


def test_what_does_not_count_has_no_share_and_takes_no_cell():
    stiffness, counted = np.array([[1.0], [1.0], [3e4], [3e4]]), np.array([[True], [False], [False], [False]])
    assert mixing_shares(stiffness, counted).T.tolist() == [[1, 0, 0, 0]]


def test_bone_takes_a_cell_that_it_fills_and_holds_the_corners_of_another():
    moduli = halves(0.25 + 1 / 8, SOFT, BONE).moduli(ss.Grid.unit_cube(5))
    assert moduli.rigid[:, 1, 1].tolist() == [False, False, True, True]
    assert moduli.shear == pytest.approx(SOFT.shear_modulus)
    assert moduli.rigid_nodes[:, 2, 2].tolist() == [False, False, True, True, True]
    assert moduli.bone.cells[:, 0].tolist() == [1] * 16
    np.testing.assert_allclose(moduli.bone.shares.sum(axis=1), 0.6)  # three of the five samples along the axis
    np.testing.assert_allclose(moduli.bone.facing, [[1, 0, 0]] * 16)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("fifths", range(6))
def test_a_wall_within_a_cell_stands_where_bone_begins(fifths, axis):
    """Pulled at the free face, a bar moves by T w / E: that says where the wall is."""
    soft, wall = Material(stiffness_kpa=1, poissons_ratio=0), 0.4 + 0.2 * (1 - fifths / 5)
    tissues, (free, pinned) = halves(wall, soft, BONE, voxels=100, axis=axis), ("xyz"[axis] + side for side in "-+")
    solver = ElasticSolver(ss.Tissue(ss.Grid.unit_cube(6), free, pinned_faces=(pinned,)), tissues, nodes=6**3)
    forces = np.zeros((3, 6, 6, 6))
    np.moveaxis(forces[axis], axis, 0)[0] = np.outer(*[[0.1, 0.2, 0.2, 0.2, 0.2, 0.1]] * 2)
    state = solver.equilibrium(forces, tolerance=1e-5)
    assert np.moveaxis(state.displacement[axis], axis, 0)[0].mean() == pytest.approx(wall, abs=0.1 * 0.2)
    np.testing.assert_allclose(solver.reaction(state), -forces.sum(axis=(1, 2, 3)), atol=1e-4)


def test_rigid_tissue_that_fills_the_box_is_refused():
    with pytest.raises(ValueError, match="rigid tissue fills the box, so nothing can move"):
        halves(0.5, BONE, BONE).moduli(ss.Grid.unit_cube(5))
    with pytest.raises(ValueError, match="rigid tissue and pinned faces hold every node of the solver's grid"):
        ElasticSolver(ss.Tissue(ss.Grid.unit_cube(5)), halves(0.75, BONE, SOFT), nodes=5**3)


def test_a_fluid_shears_freely_at_constant_volume():
    water = Material(stiffness_kpa=4, fluid=True)
    solid = Material(stiffness_kpa=4)
    assert water.lame_moduli[0] == solid.lame_moduli[0]
    assert water.lame_moduli[1] == pytest.approx(FLUID_SHEAR * solid.lame_moduli[1])


def test_a_needle_meets_no_force_in_a_fluid():
    tissues = halves(0.5, Material(friction_n_per_mm=0.02, cutting_force_n=0.3), Material(fluid=True))
    friction, cutting = tissues.resistance(np.array([[0.25, 0.5, 0.5], [0.75, 0.5, 0.5]]))
    assert friction.tolist() == [0.02, 0] and cutting.tolist() == [0.3, 0]


def test_the_picture_of_stiffness_orders_tissues_and_is_not_blinded_by_bone():
    labels = np.arange(4, dtype=np.uint8).repeat(4).reshape(4, 2, 2)
    tissues = TissueMap(Volume(voxels=labels, spacing=(1, 1, 1)), {0: STIFF, 1: BONE, 2: SOFT, 3: STIFF})
    assert tissues.stiffness_image().voxels[:, 0, 0].tolist() == [1, 2, 0, 1]


def test_a_label_map_in_another_frame_is_resampled(a_rotation):
    tissues = halves(0.5, SOFT, STIFF)
    turned = Volume(
        voxels=tissues.labels.voxels,
        spacing=tissues.labels.spacing,
        origin=a_rotation @ tissues.labels.origin,
        direction=a_rotation,
    )
    grid = ss.Grid(shape=(5, 5, 5), spacing=0.25, direction=a_rotation)
    expected = tissues.moduli(ss.Grid.unit_cube(5)).shear
    np.testing.assert_allclose(TissueMap(turned, tissues.materials).moduli(grid).shear, expected, rtol=1e-6)
    straight = ss.Grid(shape=(5, 5, 5), spacing=0.1, origin=a_rotation @ [0.5, 0.5, 0.5] - 0.2)
    assert TissueMap(turned, tissues.materials).moduli(straight).shear.max() > SOFT.lame_moduli[1]


def test_a_label_map_elsewhere_is_refused():
    tissues = halves(0.5, SOFT, STIFF)
    elsewhere = ss.Grid(shape=(5, 5, 5), spacing=0.25, origin=(10, 0, 0))
    with pytest.raises(ValueError, match="labels do not overlap the tissue's box"):
        tissues.moduli(elsewhere)


def test_a_fluid_at_every_face_is_refused():
    labels = np.zeros((16, 16, 16), np.int16)
    labels[6:10, 6:10, 6:10] = 7
    volume = Volume(voxels=labels, spacing=(1 / 16,) * 3, origin=(1 / 32,) * 3)
    tissues = TissueMap(volume, {0: Material(stiffness_kpa=4, fluid=True), 7: STIFF})
    with pytest.raises(ValueError, match="the fluid reaches every face of the box"):
        ElasticSolver(ss.Tissue(ss.Grid.unit_cube(9)), tissues, nodes=9**3)


def test_a_label_without_material_is_named():
    volume = halves(0.5, SOFT, STIFF).labels
    with pytest.raises(ValueError, match=r"labels \[7\] have no material; add them to those of \[0\]"):
        TissueMap(volume, {0: SOFT})
    with pytest.raises(ValueError, match=r"labels \[7\] have no name; known are 0, 3"):
        TissueMap.named(volume, {0: "liver", 3: "bone"}, MaterialTable.assumed())
    with pytest.raises(ValueError, match=r"label 'unobtainium' has no material; .*use one of soft_tissue, skin"):
        TissueMap.named(volume, {0: "liver", 7: "unobtainium"}, MaterialTable.assumed())


def test_labels_that_are_no_whole_numbers_are_refused():
    with pytest.raises(ValueError, match=r"a voxel of 0\.5; give a label map, whole numbers 0 to"):
        TissueMap(Volume(voxels=np.full((4, 4, 4), 0.5), spacing=(1, 1, 1)), {0: SOFT})


def test_a_table_of_materials_is_read_and_joins_the_assumed_ones(tmp_path):
    file = tmp_path / "mine.toml"
    plate = "[plate]\nrigid = true\n"  # what does not deform needs no stiffness
    file.write_text(
        f'[liver]\nstiffness_kpa = 7.5\nsource = "my elastography"\n["gland_*"]\nstiffness_kpa = 9\n{plate}'
    )
    table = MaterialTable.read(file)
    assert (table["liver"].stiffness_kpa, table["liver"].source) == (7.5, "my elastography")
    assert table["gland_left"].stiffness_kpa == 9
    assert table["plate"].rigid
    assert table["rib_right_9"].rigid and table["rib_right_9"].source == "assumed"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[liver]\nstiffness_kpa = -1", r"\[liver\] stiffness_kpa = -1 is out of range"),
        ("[liver]\nstiffness = 1", r"\[liver\] has an unknown key 'stiffness'; use stiffness_kpa"),
        ("[liver]\npoissons_ratio = 0.4", r"\[liver\] lacks stiffness_kpa"),
        ("liver = 5", r"liver = 5 is not a table; write \[liver\]"),
        ("[liver", "is not TOML"),
    ],
)
def test_a_bad_table_is_refused_and_named(tmp_path, text, message):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        MaterialTable.read(file)


def test_label_names_need_their_columns(tmp_path):
    file = tmp_path / "names.csv"
    file.write_text("number,tissue\n5,liver\n")
    with pytest.raises(ValueError, match="lacks the column 'label'; give a CSV file with columns label,name"):
        read_label_names(file)
    with pytest.raises(ValueError, match="does not exist; give a CSV file"):
        read_label_names(tmp_path / "absent.csv")


def test_every_assumed_material_says_where_it_is_from():
    assert all(material.source for material in MaterialTable.assumed().materials.values())


def test_a_real_abdomen_becomes_tissue(shared_data):
    tissues = TissueMap.read(shared_data / "abdomen_labels.nii.gz")
    tissue = ss.Tissue(tissues.labels.grid(20_000), entry_face="y+")
    solver = ElasticSolver(tissue, tissues, nodes=20_000)
    assert solver.moduli.shear.max() / solver.moduli.shear.min() > 1000  # ribs against lung


def test_the_strain_is_found_where_it_is_largest(a_tilted_grid):
    values = np.zeros((*a_tilted_grid.shape, 3))
    values[4, 3, 5] = 0.3
    found = largest_strain(ss.GridField(a_tilted_grid, values))
    assert not ss.GridField(a_tilted_grid, values).values[0].any()
    assert np.abs(found.place - a_tilted_grid.node([[4, 3, 5]])).max() < max(a_tilted_grid.spacing)
    assert found.largest > 0.02


def test_what_linear_theory_costs_grows_with_the_gradient_and_beyond_what_was_measured():
    small, large, huge = (Strain(gradient, np.zeros(3)).theory_error for gradient in (0.1, 0.5, 1.84))
    assert 0.008 < small.mean[0] < small.mean[1] < 0.025
    assert large.mean == pytest.approx((0.045, 0.19), rel=0.05)  # 0.036 at the gradient of 0.5 of another scene
    assert huge.peak == pytest.approx([2 * share for share in Strain(0.92, np.zeros(3)).theory_error.peak])
    assert Strain(0.0, np.zeros(3)).theory_error.mean == (0, 0)


def test_cubes_hold_their_tissues():
    for name, count in (("homogeneous", 1), ("layers", 3), ("body", 7)):
        assert len(labelled_cube(name, voxels=48).materials) == count


def with_property(name, default, help):
    """Material with one more property."""
    about = Material.__dataclass_fields__["friction_n_per_mm"].metadata | {"help": help}
    added = (name, float, field(default=default, metadata=about))
    return make_dataclass("Material", [added], bases=(Material,), frozen=True)


def test_a_property_is_added_in_one_place(monkeypatch, tmp_path):
    """Its check, its key in a table, the errors about it and its line in the docs follow."""
    monkeypatch.setattr(material_table, "Material", with_property("damping_s", 0.1, "Relaxation, in s."))
    file = tmp_path / "mine.toml"
    file.write_text("[liver]\nstiffness_kpa = 6\ndamping_s = 0.25\n")
    assert MaterialTable.read(file)["liver"].damping_s == 0.25
    file.write_text("[liver]\nstiffness_kpa = 6\ndamping_s = -1\n")
    with pytest.raises(ValueError, match=r"\[liver\] damping_s = -1 is out of range; give a finite number at or above"):
        MaterialTable.read(file)
    file.write_text("[liver]\nstiffness_kpa = 6\ndumping_s = 1\n")
    with pytest.raises(ValueError, match=r"unknown key 'dumping_s'; use stiffness_kpa, .*, source, damping_s"):
        MaterialTable.read(file)
    assert "damping_s : float, default: 0.1\n        Relaxation, in s." in parameters(material_table.Material)


def test_every_property_is_in_the_docs():
    for known in fields(Material):
        assert f"\n    {known.name} : {known.type}, default: {known.default!r}\n" in Material.__doc__
        assert known.metadata["help"] in Material.__doc__


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("rigid", "yes", "rigid = 'yes' is neither true nor false; give one of them"),
        ("fluid", 2, "fluid = 2 is neither true nor false"),
        ("source", 5, "source = 5 is not a text"),
        ("friction_n_per_mm", "low", "friction_n_per_mm = 'low' is not a number"),
    ],
)
def test_a_property_of_another_kind_is_refused(name, value, problem):
    with pytest.raises(ValueError, match=problem):
        Material(**{"stiffness_kpa": 6, name: value})


EXAMPLES = {
    "stiffness_kpa": 7.5, "poissons_ratio": 0.4, "friction_n_per_mm": 0.05, "track_friction_n_per_mm": 0.06,
    "static_friction": 1.2, "viscous_friction": 0.001, "cutting_force_n": 1.5, "lateral_strength_n_per_mm": 0.3,
    "rigid": True, "floating": True,
    "fluid": True, "relaxation_exponent": 0.1, "source": "my elastography",
}  # fmt: skip


def test_a_property_of_a_material_is_written_once_and_read_everywhere(tmp_path):
    """A new field of Material needs no other line: the reader, its errors and the docs follow."""
    assert set(EXAMPLES) == {entry.name for entry in fields(Material)}, "give the new property an example"
    written = [
        f"{name} = {str(value).lower() if isinstance(value, bool) else repr(value)}" for name, value in EXAMPLES.items()
    ]
    file = tmp_path / "m.toml"
    file.write_text("\n".join(["[liver]", *written]))
    assert MaterialTable.read(file)["liver"] == Material(**EXAMPLES)
    file.write_text("[liver]\nstiffness_kpa = 1\ncolour = 3\n")
    with pytest.raises(ValueError, match="unknown key 'colour'; use " + ", ".join(EXAMPLES)):
        MaterialTable.read(file)
