"""The finite element reference: exact solutions, symmetries, load cases, solvers and errors."""

import re

import numpy as np
import pytest

import sonospline as ss
from elastic_problems import largest_difference, manufactured_error, on_grid, patch_error
from sonospline import _extras, _memory
from sonospline._extras import MissingExtraError
from sonospline.fem import FiniteElementModel, fenicsx, reference_history, scikit
from sonospline.fem.scikit import ScikitFem
from sonospline.fem.scikit_assembly import assemble
from sonospline.mechanics import LineForce, Material, Moduli, ShaftDisplacement

pytest.importorskip("skfem", reason="needs the extra 'fem'")
pytest.importorskip("pyamg", reason="needs the extra 'fem'")

ELEMENTS = ("hexahedron", "tetrahedron")
INTEGRATIONS = ("full", "mean_dilatation")
SOLVERS = ("multigrid", "direct", "from_scratch")
LOADS = (LineForce(), ShaftDisplacement())


def subsampled_difference(fine, coarse):
    """Mean difference on the nodes of the coarse grid, relative to the mean displacement."""
    shared = fine[::2, ::2, ::2]
    return np.linalg.norm(shared - coarse, axis=-1).mean() / np.linalg.norm(shared, axis=-1).mean()


@pytest.mark.parametrize("integration", INTEGRATIONS)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_linear_displacement_is_reproduced(element, integration, solver, a_tilted_grid):
    for grid in (ss.Grid(shape=(4, 6, 5), spacing=(0.2, 0.1, 0.3)), a_tilted_grid):
        assert patch_error(ScikitFem, grid, element=element, integration=integration, solver=solver) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("integration", INTEGRATIONS)
@pytest.mark.parametrize("element", ELEMENTS)
def test_a_smooth_displacement_is_approached_at_second_order(element, integration):
    options = {"element": element, "integration": integration, "solver": "multigrid"}
    coarse, fine = (manufactured_error(ScikitFem, nodes, **options) for nodes in (9, 17))
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.2)
    assert fine < 0.04


def test_the_mean_dilatation_is_the_mean_over_the_element():
    """One box: its dilatational stiffness is lambda V d d^T, with d the mean divergence of each unknown."""
    grid = ss.Grid(shape=(2, 2, 2), spacing=(0.7, 1.1, 0.4))
    system = on_grid(grid, element="hexahedron", integration="mean_dilatation")
    gauss = np.array(np.meshgrid(*[[0.5 - 12**-0.5, 0.5 + 12**-0.5]] * 3)).reshape(3, -1).T
    mean = np.zeros((8, 3))
    for number, corner in enumerate(np.rint(grid.points / grid.spacing)):
        along = np.where(corner, gauss, 1 - gauss)
        for axis in range(3):
            others = np.prod(np.delete(along, axis, axis=1), axis=1)
            mean[number, axis] = ((2 * corner[axis] - 1) / grid.spacing[axis] * others).mean()
    mean = mean.ravel()
    expected = system.material.first_lame * np.prod(grid.spacing) * np.outer(mean, mean)
    averaged = assemble(system).stiffness.toarray()
    full = assemble(on_grid(grid, element="hexahedron")).stiffness.toarray()
    # a compressible material of the same shear modulus has the shear part alone
    compressible = on_grid(grid, element="hexahedron", poissons_ratio=0.0)
    ratio = system.material.shear_modulus / compressible.material.shear_modulus
    shear = ratio * assemble(compressible).stiffness.toarray()
    assert np.allclose(averaged - shear, expected, rtol=0, atol=1e-13)
    assert not np.allclose(full - shear, expected, rtol=0, atol=1e-3)


@pytest.mark.slow
def test_full_integration_locks_and_mean_dilatation_does_not(monkeypatch):
    monkeypatch.setattr("sonospline.fem.model.check_locking", lambda *_: None)
    material = Material(poissons_ratio=0.49)
    needle = ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5))
    errors = {}
    for integration in INTEGRATIONS:
        coarse, fine = (
            FiniteElementModel(ss.Tissue(ss.Grid.unit_cube(nodes)), material, integration=integration).solve(
                LineForce(), needle
            )
            for nodes in (13, 25)
        )
        errors[integration] = subsampled_difference(fine, coarse)
    assert errors["full"] > 0.1
    assert errors["mean_dilatation"] < errors["full"] / 3


@pytest.mark.slow
@pytest.mark.parametrize("load", LOADS, ids=["F", "D"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_all_solvers_give_the_same(unit_tissue, an_oblique_needle, element, load):
    models = {solver: FiniteElementModel(unit_tissue, element=element, solver=solver) for solver in SOLVERS}
    fields = {solver: model.solve(load, an_oblique_needle) for solver, model in models.items()}
    assert largest_difference(fields["multigrid"], fields["direct"]) < 1e-9
    assert largest_difference(fields["from_scratch"], fields["direct"]) < 1e-9


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_what_is_clamped_does_not_move_and_the_entry_face_does(unit_tissue, an_oblique_needle, integration):
    u = FiniteElementModel(unit_tissue, integration=integration).solve(LineForce(), an_oblique_needle)
    assert unit_tissue.boundary_drift(u) == 0
    assert np.abs(u[0, 1:-1, 1:-1]).max() > 1e-4


@pytest.mark.parametrize("nodes", [17, pytest.param(25, marks=pytest.mark.slow)])
def test_the_paper_sized_load_moves_tissue_as_far_as_measured(nodes):
    """Largest 0.027 to 0.029 and mean 0.0026 to 0.0033 of the side, at 25^3; a little less on coarser meshes."""
    tissue = ss.Tissue(ss.Grid.unit_cube(nodes))
    u = FiniteElementModel(tissue).solve(LineForce(), ss.Needle((0, 0.4, 0.6), (0.6, 0.5, 0.5)))
    length = np.linalg.norm(u, axis=-1)
    assert 0.0255 < length.max() < 0.03
    assert 0.0026 < length[~tissue.pinned].mean() < 0.0033


@pytest.mark.parametrize("load", LOADS, ids=["F", "D"])
def test_a_mirrored_needle_gives_the_mirrored_field(small_tissue, load):
    model = FiniteElementModel(small_tissue, solver="direct")
    load = ShaftDisplacement(radius=0.07) if isinstance(load, ShaftDisplacement) else load
    u = model.solve(load, ss.Needle((0, 0.375, 0.5), (0.61, 0.47, 0.56)))
    mirrored = model.solve(load, ss.Needle((0, 0.625, 0.5), (0.61, 0.53, 0.56)))
    assert largest_difference(mirrored, u[:, ::-1] * (1, -1, 1)) < 1e-12


def test_the_six_tetrahedra_treat_all_axes_alike():
    """Kuhn's split is symmetric under an exchange of axes."""
    u = FiniteElementModel(ss.Tissue(ss.Grid.unit_cube(9)), element="tetrahedron", solver="direct").solve(
        LineForce(), ss.Needle((0, 0.4, 0.55), (0.6, 0.5, 0.45))
    )
    exchanged = FiniteElementModel(
        ss.Tissue(ss.Grid.unit_cube(9), entry_face="z-"), element="tetrahedron", solver="direct"
    ).solve(LineForce(), ss.Needle((0.55, 0.4, 0), (0.45, 0.5, 0.6)))
    assert largest_difference(exchanged, u.transpose(2, 1, 0, 3)[..., ::-1]) < 1e-12


@pytest.mark.parametrize("load", LOADS, ids=["F", "D"])
@pytest.mark.parametrize("entry_face", ["x-", "y+"])
def test_a_turned_grid_gives_the_turned_field(a_rotation, load, entry_face):
    """Anisotropic, not a cube, away from the origin."""
    shape, spacing = (9, 12, 10), np.array([0.12, 0.09, 0.1])
    load = ShaftDisplacement(radius=0.1) if isinstance(load, ShaftDisplacement) else load
    straight = ss.Grid(shape=shape, spacing=spacing)
    turned = ss.Grid(shape=shape, spacing=spacing, origin=(-30, 12, 7), direction=a_rotation)
    needle = np.array([[0.1, 0.45, 0.5], [0.6, 0.5, 0.41]])
    fields = [
        FiniteElementModel(ss.Tissue(grid, entry_face=entry_face), solver="direct").solve(
            load, ss.Needle(*grid.world(needle))
        )
        for grid in (straight, turned)
    ]
    assert largest_difference(fields[1], fields[0] @ a_rotation.T) < 1e-11


def test_the_field_is_linear_in_the_force_and_in_one_over_the_modulus(small_tissue, an_oblique_needle):
    def solve(friction, tip_force, modulus=1.0):
        model = FiniteElementModel(small_tissue, Material(stiffness_kpa=modulus), solver="direct")
        return model.solve(LineForce(friction=friction, tip_force=tip_force), an_oblique_needle)

    shaft, tip, both = solve(0.03, 0), solve(0, 0.007), solve(0.06, 0.021)
    assert largest_difference(both, 2 * shaft + 3 * tip) < 1e-12
    assert largest_difference(solve(0.03, 0, modulus=4.0), shaft / 4) < 1e-12
    assert not solve(0, 0).any()


def test_millimetres_and_kilopascals_scale_with_the_cube(small_tissue):
    needle = np.array([[0, 0.5, 0.5], [0.6, 0.45, 0.5]])
    unit = FiniteElementModel(small_tissue).solve(LineForce(), ss.Needle(*needle))
    block = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5))
    model = FiniteElementModel(block, Material(stiffness_kpa=10))
    assert largest_difference(model.solve(LineForce.for_cube(100, 10), ss.Needle(*100 * needle)), 100 * unit) < 1e-9
    held = ShaftDisplacement.for_cube(100)
    assert (held.shaft, held.tip, held.radius, held.tip_length) == pytest.approx((2.27, 2.66, 3.0, 6.0))


@pytest.mark.parametrize("solver", SOLVERS)
def test_held_nodes_move_along_the_needle_as_told_and_freely_across(unit_tissue, an_oblique_needle, solver):
    load = ShaftDisplacement(radius=0.08)
    model = FiniteElementModel(unit_tissue, solver=solver)
    u = model.solve(load, an_oblique_needle)
    grid = unit_tissue.grid
    seen = an_oblique_needle.project(grid.points)
    held = (seen.along >= 0) & (seen.along <= an_oblique_needle.depth) & (seen.distance <= 0.08)
    held &= ~unit_tissue.pinned.ravel()
    at_tip = held & (seen.along >= an_oblique_needle.depth - 0.06)
    assert held.sum() > 10
    assert at_tip.any()
    along = u.reshape(-1, 3) @ an_oblique_needle.direction
    assert np.allclose(along[held], np.where(at_tip, load.tip, load.shaft)[held], rtol=0, atol=1e-15)
    across = u.reshape(-1, 3)[held] - along[held, None] * an_oblique_needle.direction
    assert np.linalg.norm(across, axis=1).max() > 1e-4
    assert unit_tissue.boundary_drift(u) == 0


def test_nothing_acts_across_the_needle_on_held_nodes_nor_at_all_elsewhere(small_tissue, an_oblique_needle):
    """Equilibrium: the forces that hold the nodes point along the needle."""
    load = ShaftDisplacement(radius=0.08)
    model = FiniteElementModel(small_tissue, solver="direct")
    u = model.solve(load, an_oblique_needle)
    world = FiniteElementModel(small_tissue)._system()
    forces = (assemble(world).stiffness @ u.ravel()).reshape(-1, 3)[~world.pinned]
    points = world.points[~world.pinned]
    held = np.isfinite(load.axial_displacement(points, an_oblique_needle))
    direction = an_oblique_needle.direction
    assert np.abs(forces[~held]).max() < 1e-9 * np.abs(forces).max()
    assert np.abs(forces[held] - (forces[held] @ direction)[:, None] * direction).max() < 1e-9 * np.abs(forces).max()


def test_a_load_that_meets_no_node_moves_nothing_and_says_so(small_tissue, caplog):
    load = ShaftDisplacement(radius=0.032)
    u = FiniteElementModel(small_tissue).solve(load, ss.Needle((0, 0.44, 0.56), (0.1, 0.44, 0.56)))
    assert not u.any()
    assert "acts on no node" in caplog.text


@pytest.mark.parametrize(("solver", "times_made"), [("multigrid", 1), ("direct", 1), ("from_scratch", 3)])
def test_what_does_not_change_is_made_once(small_tissue, monkeypatch, solver, times_made):
    made = []
    monkeypatch.setattr(scikit, "assemble", lambda system: made.append(1) or assemble(system))
    model = FiniteElementModel(small_tissue, solver=solver)
    for tip in ((0.3, 0.5, 0.5), (0.6, 0.5, 0.5), (0.6, 0.4, 0.5)):
        model.solve(LineForce(), ss.Needle((0, 0.5, 0.5), tip))
    assert len(made) == times_made
    assert len(model.times) == 3
    assert all((times.iterations == 0) == (solver == "direct") for times in model.times)
    assert all(times.total_s == pytest.approx(sum(times[:4])) for times in model.times)


NEEDLE = ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda t: Material(stiffness_kpa=0), "stiffness_kpa = 0 is out of range"),
        (lambda t: Material(stiffness_kpa=-1), "stiffness_kpa = -1 is out of range"),
        (lambda t: Material(stiffness_kpa=np.nan), "stiffness_kpa = nan is out of range"),
        (lambda t: Material(stiffness_kpa="stiff"), "stiffness_kpa = 'stiff' is not a number"),
        (lambda t: Material(poissons_ratio=0.5), "poissons_ratio = 0.5 .* give less than 0.5"),
        (lambda t: Material(poissons_ratio=np.inf), "poissons_ratio = inf"),
        (lambda t: Material(poissons_ratio=-0.1), "poissons_ratio = -0.1"),
        (lambda t: LineForce(friction=np.nan), "friction = nan"),
        (lambda t: LineForce(width=0), "width = 0 .* above zero"),
        (lambda t: LineForce.for_cube(0), "side = 0"),
        (lambda t: LineForce.for_cube(1, -2), "youngs_modulus = -2"),
        (lambda t: ShaftDisplacement(radius=0), "radius = 0 .* above zero"),
        (lambda t: ShaftDisplacement(tip=-1), "tip = -1"),
        (
            lambda t: FiniteElementModel(t, Material(poissons_ratio=0.49)),
            "poissons_ratio = 0.49 .* 'full' locks above 0.47; use .*integration='mean_dilatation'",
        ),
        (
            lambda t: FiniteElementModel(
                t, Material(poissons_ratio=0.49), element="tetrahedron", integration="mean_dilatation"
            ),
            "tetrahedra lock above 0.47; use element='hexahedron'",
        ),
        (
            lambda t: FiniteElementModel(t, Material(poissons_ratio=0.4999), integration="mean_dilatation"),
            "poissons_ratio = 0.4999 .* at most 0.499",
        ),
        (lambda t: FiniteElementModel(t, element="wedge"), "element = 'wedge' .* hexahedron, tetrahedron"),
        (lambda t: FiniteElementModel(t, integration="reduced"), "integration = 'reduced' .* full, mean_dilatation"),
        (lambda t: FiniteElementModel(t, engine="abaqus"), "engine = 'abaqus' .* scikit-fem, fenicsx"),
        (lambda t: FiniteElementModel(t, solver="magic"), "solver = 'magic' .* multigrid, direct, from_scratch"),
        (lambda t: FiniteElementModel(t, tolerance=0), "tolerance = 0"),
        (lambda t: FiniteElementModel(t, tolerance=2.0), "tolerance = 2"),
        (lambda t: FiniteElementModel(t.grid), "is not a Tissue"),
        (lambda t: FiniteElementModel(t, LineForce()), "is not a Material"),
        (lambda t: FiniteElementModel(t).solve(Material(), NEEDLE), "is not a load case"),
        (lambda t: FiniteElementModel(t).solve(LineForce(), (0.6, 0.5, 0.5)), "is not a Needle"),
        (
            lambda t: FiniteElementModel(t).solve(LineForce(), ss.Needle((0, 0.5, 0.5), (1.1, 0.5, 0.5))),
            r"tip = \[1.1, 0.5, 0.5\] lies outside the tissue",
        ),
        (lambda t: reference_history(t, (-1, 0.5, 0.5), (0.6, 0.5, 0.5)), "entry = .* outside the tissue"),
        (lambda t: reference_history(t, (0, 0.5, 0.5), (0, 0.5, 0.5)), "equals the entry"),
        (lambda t: reference_history(t, (0, 0.5, 0.5), (0.6, 0.5, 0.5), steps=0), "steps = 0"),
        (lambda t: reference_history(t, (0, 0.5, np.nan), (0.6, 0.5, 0.5)), "NaN"),
        (
            lambda t: FiniteElementModel(ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5))).solve(
                LineForce(), ss.Needle((0, 50, 50), (60, 50, 50))
            ),
            r"falls between nodes 12.5 apart; .*LineForce.for_cube\(100\)",
        ),
    ],
)
def test_bad_input_is_refused_with_a_remedy(small_tissue, make, message):
    with pytest.raises(ValueError, match=message):
        make(small_tissue)


def test_a_missing_engine_is_one_line_that_says_how_to_get_it(small_tissue, monkeypatch):
    monkeypatch.delenv(fenicsx.VARIABLE, raising=False)
    monkeypatch.setattr(fenicsx, "_has_dolfinx", lambda python: False)
    with pytest.raises(MissingExtraError, match=r"^DOLFINx .*make fenicsx .*SONOSPLINE_FENICSX_PYTHON$"):
        FiniteElementModel(small_tissue, engine="fenicsx")
    monkeypatch.setenv(fenicsx.VARIABLE, "/no/such/python")
    with pytest.raises(MissingExtraError, match=r"^SONOSPLINE_FENICSX_PYTHON = '/no/such/python' .* unset it$"):
        FiniteElementModel(small_tissue, engine="fenicsx")
    monkeypatch.setattr(_extras, "present", lambda module: module != "pyamg")
    with pytest.raises(MissingExtraError, match=re.escape("pip install 'sonospline[fem]'")):
        FiniteElementModel(small_tissue)


def test_a_grid_or_a_factor_too_large_for_the_memory_is_refused(small_tissue, monkeypatch):
    monkeypatch.setattr(_memory, "available_bytes", lambda: 2_000_000)
    monkeypatch.setattr(_memory, "_NEVER_REFUSED", 0)
    with pytest.raises(ValueError, match=r"grid = \(9, 9, 9\): the finite element matrices would take"):
        FiniteElementModel(small_tissue)
    monkeypatch.setattr(_memory, "available_bytes", lambda: 12_000_000)
    with pytest.raises(ValueError, match=r"solver = 'direct': the factor of 1,176 unknowns .*would take"):
        for solver in ("SUPERLU", "PARDISO"):
            monkeypatch.setattr(f"sonospline.fem.sparse_solvers._BYTES_{solver}", 10_000)
        FiniteElementModel(small_tissue, solver="direct").solve(LineForce(), NEEDLE)


def test_iterations_that_do_not_converge_are_an_error(small_tissue, monkeypatch):
    monkeypatch.setattr("sonospline.fem.sparse_solvers._MOST_ITERATIONS", 3)
    with pytest.raises(RuntimeError, match="after 3 iterations; use solver='direct'"):
        FiniteElementModel(small_tissue).solve(LineForce(), NEEDLE)


def test_a_material_of_equal_cells_is_that_material(unit_tissue, an_oblique_needle):
    solid, cells = Material(2.0, 0.3), (12, 12, 12)
    material = Moduli(unit_tissue.grid, np.full(cells, solid.first_lame), np.full(cells, solid.shear_modulus))
    for element in ("hexahedron", "tetrahedron"):
        ours, theirs = (
            FiniteElementModel(unit_tissue, m, element=element).solve(LineForce(), an_oblique_needle)
            for m in (material, solid)
        )
        assert largest_difference(ours, theirs) < 1e-9


def test_cells_that_do_not_fit_or_have_no_stiffness_are_refused(unit_tissue):
    cells = np.ones((12, 12, 12))
    with pytest.raises(ValueError, match=r"material has \(11, 12, 12\) cells; give the grid's \(12, 12, 12\)"):
        FiniteElementModel(unit_tissue, Moduli(ss.Grid(shape=(12, 13, 13), spacing=1 / 12), cells[1:], cells[1:]))
    with pytest.raises(ValueError, match="shear = 0 or lame = 1 is out of range"):
        Moduli(unit_tissue.grid, cells, 0 * cells)
    with pytest.raises(ValueError, match="one value a cell of the grid"):
        Moduli(unit_tissue.grid, cells, cells[1:])
