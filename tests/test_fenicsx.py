"""DOLFINx against scikit-fem and exact solutions.

Skipped where no Python has DOLFINx, unless SONOSPLINE_REQUIRE_FENICSX is set, as in CI.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

import sonospline as ss
from elastic_problems import largest_difference, manufactured_error, patch_error
from labelled_tissue import away_from_reference, bone_in_part, bone_of
from sonospline._extras import MissingExtraError
from sonospline.fem import FiniteElementModel, fenicsx, reference_history
from sonospline.fem.fenicsx import FEniCSx
from sonospline.mechanics import LABELLED_CUBES, LineForce, Material, Moduli, ShaftDisplacement, labelled_cube

ELEMENTS = ("hexahedron", "tetrahedron")
SOLVERS = ("multigrid", "direct", "from_scratch")


@pytest.fixture(autouse=True, scope="module")
def dolfinx():
    try:
        fenicsx.interpreter()
    except MissingExtraError as absent:
        if os.environ.get("SONOSPLINE_REQUIRE_FENICSX"):
            raise
        pytest.skip(str(absent))


def both(tissue, load, needle, **options):
    """The fields of the two engines."""
    pytest.importorskip("skfem", reason="needs the extra 'fem'")
    return [
        FiniteElementModel(tissue, engine=engine, **options).solve(load, needle) for engine in ("fenicsx", "scikit-fem")
    ]


@pytest.mark.slow
@pytest.mark.parametrize("integration", ["full", "mean_dilatation"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_a_linear_displacement_is_reproduced(element, integration, a_tilted_grid):
    for solver in SOLVERS:
        grid = a_tilted_grid if solver == "direct" else ss.Grid(shape=(4, 6, 5), spacing=(0.2, 0.1, 0.3))
        assert patch_error(FEniCSx, grid, element=element, integration=integration, solver=solver) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("element", ELEMENTS)
def test_a_smooth_displacement_is_approached_at_second_order(element):
    coarse, fine = (manufactured_error(FEniCSx, nodes, element=element, solver="multigrid") for nodes in (9, 17))
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.2)


@pytest.mark.parametrize("solver", [SOLVERS[0], *(pytest.param(name, marks=pytest.mark.slow) for name in SOLVERS[1:])])
@pytest.mark.parametrize("element", ELEMENTS)
def test_it_agrees_with_scikit_fem(unit_tissue, an_oblique_needle, element, solver):
    ours, theirs = both(unit_tissue, LineForce(), an_oblique_needle, element=element, solver=solver)
    assert largest_difference(ours, theirs) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("element", ELEMENTS)
def test_it_agrees_with_scikit_fem_on_the_papers_mesh(an_oblique_needle, element):
    tissue = ss.Tissue(ss.Grid.unit_cube(25))
    assert largest_difference(*both(tissue, LineForce(), an_oblique_needle, element=element)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("element", ELEMENTS)
def test_it_agrees_where_every_cell_is_as_stiff_as_it_likes(unit_tissue, an_oblique_needle, element, rng):
    shear = np.exp(rng.normal(size=(12, 12, 12)))
    material = Moduli(unit_tissue.grid, 9 * shear * rng.random(shear.shape), shear)
    ours, theirs = both(unit_tissue, LineForce(), an_oblique_needle, element=element, material=material)
    assert largest_difference(ours, theirs) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.30, 0.45, 0.49])
@pytest.mark.parametrize("name", LABELLED_CUBES)
def test_the_live_solver_converges_to_its_field_in_every_cube(name, ratio):
    tissues = labelled_cube(name, voxels=48, poissons_ratio=ratio)
    assert away_from_reference(tissues, 9, engine="fenicsx", solver="direct") < 3e-4


def test_the_live_solver_converges_to_its_field_beside_rigid_bone():
    assert away_from_reference(bone_of(1e6), 9, engine="fenicsx", solver="direct") < 3e-4


@pytest.mark.parametrize("load", [LineForce(), ShaftDisplacement(radius=0.1, tip_length=0.2)], ids=["force", "held"])
def test_bone_that_ends_within_cells_holds_them_alike(an_oblique_needle, load):
    """A shaft that is held takes the axes of the needle: springs turn with them."""
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    options = {"integration": "mean_dilatation", "solver": "direct"}
    ours, theirs = both(tissue, load, an_oblique_needle, material=bone_in_part().moduli(tissue.grid), **options)
    assert largest_difference(ours, theirs) < 1e-8
    soft = FiniteElementModel(tissue, labelled_cube("body", voxels=30).moduli(tissue.grid), **options)
    assert largest_difference(theirs, soft.solve(load, an_oblique_needle)) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELLED_CUBES)
def test_the_live_solver_converges_to_its_field_on_a_finer_grid(name):
    assert away_from_reference(labelled_cube(name), 17, engine="fenicsx", solver="direct") < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("element", ELEMENTS)
def test_it_agrees_where_the_shaft_is_held(unit_tissue, an_oblique_needle, element):
    load = ShaftDisplacement(radius=0.06)
    ours, theirs = both(unit_tissue, load, an_oblique_needle, element=element, solver="direct")
    assert largest_difference(ours, theirs) < 1e-9


@pytest.mark.slow
def test_it_agrees_on_a_turned_anisotropic_grid_of_nearly_incompressible_tissue(a_tilted_grid):
    tissue = ss.Tissue(a_tilted_grid, entry_face="z+")
    load = LineForce.for_cube(15, 10)
    material = Material(stiffness_kpa=10, poissons_ratio=0.49)
    needle = ss.Needle(*a_tilted_grid.world(a_tilted_grid.extent * [[0.5, 0.5, 1], [0.45, 0.6, 0.4]]))
    options = {"material": material, "integration": "mean_dilatation", "solver": "direct"}
    assert largest_difference(*both(tissue, load, needle, **options)) < 1e-9


@pytest.mark.slow
def test_a_history_needs_one_worker_and_is_kept_apart(unit_tissue, tmp_path, monkeypatch):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    pytest.importorskip("skfem", reason="needs the extra 'fem'")
    path = ((0, 0.5, 0.5), (0.6, 0.5, 0.5))
    ours = reference_history(unit_tissue, *path, steps=3, engine="fenicsx")
    theirs = reference_history(unit_tissue, *path, steps=3)
    assert largest_difference(ours, theirs) < 1e-9
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.slow
def test_the_worker_keeps_its_matrices_and_ends_with_its_model(unit_tissue):
    model = FiniteElementModel(unit_tissue, engine="fenicsx", solver="direct")
    for tip in ((0.3, 0.5, 0.5), (0.6, 0.5, 0.5)):
        model.solve(LineForce(), ss.Needle((0, 0.5, 0.5), tip))
    assert [times.iterations for times in model.times] == [0, 0]
    worker = model._engine._worker
    process, folder = worker._process, worker._folder
    assert process.poll() is None
    del model, worker
    assert process.poll() == 0
    assert not folder.exists()


def test_a_worker_that_dies_says_why(unit_tissue, tmp_path, monkeypatch):
    script = tmp_path / "worker.py"
    script.write_text("import sys\nsys.exit('PETSc is out of sorts')\n")
    monkeypatch.setattr(fenicsx, "_WORKER", script)
    model = FiniteElementModel(unit_tissue, engine="fenicsx")
    with pytest.raises(RuntimeError, match="DOLFINx worker failed: PETSc is out of sorts"):
        model.solve(LineForce(), ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5)))


@pytest.mark.slow
def test_iterations_that_do_not_converge_are_an_error(unit_tissue, tmp_path, monkeypatch):
    impatient = fenicsx._WORKER.read_text().replace("_MOST_ITERATIONS = 5000", "_MOST_ITERATIONS = 3")
    (tmp_path / "worker.py").write_text(impatient)
    monkeypatch.setattr(fenicsx, "_WORKER", tmp_path / "worker.py")
    model = FiniteElementModel(unit_tissue, engine="fenicsx")
    with pytest.raises(RuntimeError, match="after 3 iterations; use solver='direct'"):
        model.solve(LineForce(), ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5)))


def test_a_python_without_dolfinx_is_not_taken(monkeypatch):
    without = subprocess.run([sys.executable, "-c", fenicsx._PROBE], check=False).returncode
    if without == 0:
        pytest.skip("this Python has DOLFINx")
    monkeypatch.setenv(fenicsx.VARIABLE, sys.executable)
    with pytest.raises(MissingExtraError, match="no Python that has DOLFINx"):
        fenicsx.interpreter()
