"""The process in which DOLFINx computes; a script that needs only NumPy and DOLFINx.

Run as ``python fenicsx_worker.py FOLDER``. Each line on its input names a task, whose
arrays lie in ``task.npz`` in that folder; when it is done, ``answer.npz`` lies beside it
and a line says so. Written for DOLFINx 0.5 and for 0.9 and newer.
"""

from __future__ import annotations

import inspect
import os
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Task = dict[str, Any]

_OPTIONS = {
    "multigrid": {
        "ksp_type": "cg",
        "pc_type": "gamg",
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_pc_type": "jacobi",
    },
    "direct": {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"},
    "from_scratch": {"ksp_type": "cg", "pc_type": "jacobi"},
}
_MOST_ITERATIONS = 5000


class Elasticity:
    """Linear elasticity on given nodes and cells."""

    def __init__(self, task: Task) -> None:
        import ufl
        from dolfinx import fem

        self._solver, self._tolerance = str(task["solver"]), float(task["tolerance"])
        self._points, self._springs = task["points"], task["springs"]
        self._mesh = _mesh(self._points, task["cells"])
        self._space = space = _vector_space(self._mesh)
        self._dofs = _dofs_of_nodes(space, len(self._points))
        self._force = fem.Function(space)
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        first_lame, shear = (_coefficient(self._mesh, task[name]) for name in ("first_lame", "shear_modulus"))
        # Two points along each axis integrate everything here exactly; the one at the centre of a
        # parallelepiped gives the mean of a trilinear displacement's divergence.
        exact = ufl.dx(metadata={"quadrature_degree": 2})
        averaged = str(task["integration"]) == "mean_dilatation"
        dilatation = ufl.dx(metadata={"quadrature_degree": 1}) if averaged else exact

        def strain(u: Any) -> Any:
            return ufl.sym(ufl.grad(u))

        energy = (
            2 * shear * ufl.inner(strain(trial), strain(test)) * exact
            + first_lame * ufl.inner(ufl.div(trial), ufl.div(test)) * dilatation
        )
        if len(task["excess"]):  # of layers, which resist the mean strain
            entries = [[_coefficient(self._mesh, task["excess"][:, i, j]) for j in range(6)] for i in range(6)]
            stress = ufl.dot(ufl.as_matrix(entries), _engineering(strain(trial)))
            mean = ufl.dx(metadata={"quadrature_degree": 1})
            energy += ufl.inner(stress, _engineering(strain(test))) * mean
        self._stiffness_form = fem.form(energy)
        self._load_form = fem.form(ufl.inner(self._force, test) * exact)
        self._stiffness: Any = None
        self._eliminated: Any = None
        self._krylov: Any = None
        self._given: Any = None

    def solve(self, task: Task) -> Task:
        """Return the displacement under one load, its times and its iterations."""
        from dolfinx.fem import petsc

        given, prescribed = task["given"], task["prescribed"]
        clock = [time.perf_counter()]
        if self._stiffness is None or self._solver == "from_scratch":
            self._stiffness, self._given = petsc.assemble_matrix(self._stiffness_form), None
            self._stiffness.assemble()
            self._hold()
        rows = (3 * self._dofs[:, None] + np.arange(3))[given].astype(np.int32)
        anew = self._given is None or not np.array_equal(self._given, given)
        if anew:
            self._eliminated = self._stiffness.copy()
            self._eliminated.zeroRowsColumns(rows, diag=1.0)
        clock.append(time.perf_counter())
        if anew:
            self._krylov, self._given = self._new_krylov(), given
        clock.append(time.perf_counter())
        self._force.x.array.reshape(-1, 3)[self._dofs] = task["body_force"]
        load = petsc.assemble_vector(self._load_form)
        known = self._stiffness.createVecRight()
        known.array[rows] = prescribed[given]
        load -= self._stiffness * known
        load.array[rows] = 0
        clock.append(time.perf_counter())
        unknown = self._stiffness.createVecRight()
        self._krylov.solve(load, unknown)
        if self._krylov.getConvergedReason() < 0:
            raise RuntimeError(
                f"the solver left a residual above {self._tolerance:g} after {self._krylov.getIterationNumber()} "
                "iterations; use solver='direct', a lower Poisson's ratio or a larger tolerance"
            )
        displacement = np.real(unknown.array + known.array).reshape(-1, 3)[self._dofs]
        clock.append(time.perf_counter())
        iterations = 0 if self._solver == "direct" else self._krylov.getIterationNumber()
        return {"displacement": displacement, "clock": clock, "iterations": iterations}

    def _hold(self) -> None:
        """Add the springs of nodes to the stiffness."""
        for node in np.flatnonzero(self._springs.any(axis=(1, 2))):
            rows = (3 * self._dofs[node] + np.arange(3)).astype(np.int32)
            self._stiffness.setValues(rows, rows, self._springs[node], addv=True)
        self._stiffness.assemble()

    def _new_krylov(self) -> Any:
        from petsc4py import PETSc

        matrix = self._eliminated
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        if self._solver == "multigrid":
            matrix.setNearNullSpace(self._rigid_motions())
        krylov = PETSc.KSP().create(matrix.comm)
        krylov.setOptionsPrefix("sonospline_")
        options = PETSc.Options()
        for name, value in _OPTIONS[self._solver].items():
            options["sonospline_" + name] = value
        krylov.setFromOptions()
        if self._solver != "direct":
            krylov.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)  # what the tolerance means
        krylov.setTolerances(rtol=self._tolerance, atol=0.0, max_it=_MOST_ITERATIONS)
        krylov.setOperators(matrix)
        krylov.setUp()
        return krylov

    def _rigid_motions(self) -> Any:
        from petsc4py import PETSc

        points = np.empty((len(self._dofs), 3))
        points[self._dofs] = self._points
        motions = np.zeros((len(points), 3, 6))
        for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            motions[:, axis, axis] = 1
            motions[:, b, 3 + axis], motions[:, a, 3 + axis] = points[:, a], -points[:, b]
        basis, _ = np.linalg.qr(motions.reshape(-1, 6))
        vectors = [self._stiffness.createVecRight() for _ in range(6)]
        for vector, motion in zip(vectors, basis.T, strict=True):
            vector.array[:] = motion
        return PETSc.NullSpace().create(vectors=vectors, comm=self._stiffness.comm)


def _mesh(points: Array, cells: NDArray[np.int64]) -> Any:
    import ufl
    from dolfinx.mesh import create_mesh
    from mpi4py import MPI

    cell = "hexahedron" if cells.shape[1] == 8 else "tetrahedron"
    try:
        import basix.ufl

        element = basix.ufl.element("Lagrange", cell, 1, shape=(3,))
    except ImportError:  # before 0.7
        element = ufl.VectorElement("Lagrange", cell, 1)
    # The element's argument changed its name, and the two their order.
    name = "domain" if "domain" in inspect.signature(create_mesh).parameters else "e"
    return create_mesh(MPI.COMM_SELF, cells=cells.astype(np.int64), x=points, **{name: ufl.Mesh(element)})


def _vector_space(mesh: Any) -> Any:
    from dolfinx import fem

    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", 1, (3,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", 1))  # before 0.8


def _dofs_of_nodes(space: Any, count: int) -> NDArray[np.int64]:
    """The block of unknowns of each node as it was given: DOLFINx numbers nodes and unknowns anew."""
    geometry = space.mesh.geometry
    nodes, dofs = (np.asarray(getattr(of, "array", of)).ravel() for of in (geometry.dofmap, space.dofmap.list))
    given = np.asarray(geometry.input_global_indices)
    blocks = np.empty(count, np.int64)
    blocks[given[nodes]] = dofs
    return blocks


def _engineering(strain: Any) -> Any:
    """xx, yy, zz, yz, xz, xy, the last three twice."""
    import ufl

    shear = [2 * strain[a, b] for a, b in ((1, 2), (0, 2), (0, 1))]
    return ufl.as_vector([strain[a, a] for a in range(3)] + shear)


def _coefficient(mesh: Any, values: Array) -> Any:
    """One value for all cells, or one of each in the order in which the cells were given."""
    from dolfinx import fem
    from petsc4py import PETSc

    if values.ndim == 0:
        return fem.Constant(mesh, PETSc.ScalarType(values))
    space = (fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace)(mesh, ("DG", 0))
    found = fem.Function(space)
    found.x.array[:] = values[mesh.topology.original_cell_index]
    return found


def _serve(folder: Path, tasks: Iterable[str], say: IO[str]) -> None:
    elasticity: Elasticity | None = None
    for line in tasks:
        with np.load(folder / "task.npz") as file:
            task = dict(file)
        if line.strip() == "build":
            elasticity, answer = Elasticity(task), Task()
        else:
            assert elasticity is not None
            answer = elasticity.solve(task)
        np.savez(folder / "answer.npz", **answer)
        say.write("done\n")
        say.flush()


if __name__ == "__main__":
    # Whatever libraries print must not be taken for an answer.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    _serve(Path(sys.argv[1]), sys.stdin, answers)
