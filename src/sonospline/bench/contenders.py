"""Everybody who can evaluate such a field, behind one small interface.

Each contender fits a problem and then evaluates it on all nodes. Peers are optional: one
that is not installed, or cannot do a size in a sensible time, says why instead.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import present
from ..fields.maps import Method
from ..models.spline.spline import PolyharmonicSpline
from .problem import Problem

Array = NDArray[np.float64]
_BLOCK = 4_000_000


class Contender(ABC):
    """One way to fit and evaluate."""

    name: str
    module: str | None = None
    """What must be installed."""

    def unable(self, problem: Problem) -> str | None:
        """Return why this contender cannot race on a problem; None where it can."""
        if self.module and not present(self.module):
            return f"{self.module} is not installed (pip install 'sonospline[bench]')"
        return None

    def unable_to_fit(self, problem: Problem) -> str | None:
        """Return why its own fit is left out; None where it is not."""
        return None

    @abstractmethod
    def fit(self, problem: Problem) -> Any:
        """Return whatever :meth:`evaluate` needs."""

    @abstractmethod
    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        """Return the displacement of all nodes, in the contender's own container."""

    def step(self, problem: Problem) -> Any:
        """Fit and evaluate."""
        return self.evaluate(problem, self.fit(problem))

    def values(self, result: Any) -> NDArray[np.floating]:
        """Return a result as (N, 3), to check it."""
        return np.asarray(result).reshape(-1, 3)


class Ours(Contender):
    """Sonospline, by one of its methods."""

    def __init__(self, method: Method) -> None:
        self.name = f"sonospline {method}"
        self.method = method

    def fit(self, problem: Problem) -> Any:
        return PolyharmonicSpline(problem.landmarks).solve(problem.values, grid=problem.grid)

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        return fitted.on_grid(self.method)


class SciPy(Contender):
    name = "scipy RBFInterpolator"

    def fit(self, problem: Problem) -> Any:
        from scipy.interpolate import RBFInterpolator

        return RBFInterpolator(problem.landmarks, problem.values, kernel="linear", degree=1)

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        return fitted(problem.grid.points)


def dense_fit(problem: Problem) -> tuple[NDArray[Any], NDArray[Any]]:
    """Weights and affine part by LAPACK, from the paper's matrix (6): the fit of peers that have none."""
    from scipy.spatial.distance import cdist

    n, points = problem.count, problem.landmarks
    system = np.zeros((n + 4, n + 4))
    system[:n, :n] = cdist(points, points)
    system[:n, n], system[:n, n + 1 :] = 1, points
    system[n:, :n] = system[:n, n:].T
    solution = np.linalg.solve(system, np.vstack([problem.values, np.zeros((4, 3))]))
    return solution[:n], solution[n:]


class PaperStep(Contender):
    """The paper's own step, equations (4) to (8): dense LU in float64, then NumPy over all nodes."""

    name = "paper's dense step (NumPy)"

    def fit(self, problem: Problem) -> Any:
        return dense_fit(problem)

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        from scipy.spatial.distance import cdist

        weights, affine = fitted
        points = problem.grid.points
        out = points @ affine[1:] + affine[0]
        for start in range(0, len(points), block := max(1, _BLOCK // problem.count)):
            part = slice(start, start + block)
            out[part] += cdist(points[part], problem.landmarks) @ weights
        return out


class Torch(Contender):
    name = "torch cdist float32"
    module = "torch"

    def unable(self, problem: Problem) -> str | None:
        needed = 4 * problem.grid.node_count * problem.count
        return super().unable(problem) or (f"needs {needed / 1e9:.0f} GB" if needed > 8e9 else None)

    def fit(self, problem: Problem) -> Any:
        import torch

        weights, affine = dense_fit(problem)
        arrays = (problem.grid.points, problem.landmarks, weights, affine)
        return [torch.as_tensor(a, dtype=torch.float32) for a in arrays]

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        import torch

        points, centres, weights, affine = fitted
        return torch.cdist(points, centres) @ weights + points @ affine[1:] + affine[0]


class KeOps(Contender):
    name = "KeOps float32"
    module = "pykeops"

    def fit(self, problem: Problem) -> Any:
        return [a.astype(np.float32) for a in (problem.grid.points, problem.landmarks, *dense_fit(problem))]

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        from pykeops.numpy import LazyTensor

        points, centres, weights, affine = fitted
        distance = ((LazyTensor(points[:, None]) - LazyTensor(centres[None])) ** 2).sum(-1).sqrt()
        return distance @ weights + points @ affine[1:] + affine[0]


class VTK(Contender):
    name = "VTK thin plate (basis R)"
    module = "vtkmodules"

    def unable(self, problem: Problem) -> str | None:
        slow = "its own fit takes most of a minute: raced at 53^3 only" if self.unable_to_fit(problem) else None
        return super().unable(problem) or (slow if problem.grid.shape != (53, 53, 53) else None)

    def unable_to_fit(self, problem: Problem) -> str | None:
        return "its own fit takes most of a minute" if problem.count > 400 else None

    def fit(self, problem: Problem) -> Any:
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonTransforms import vtkThinPlateSplineTransform

        def points(array: Array) -> Any:
            wrapped = vtkPoints()
            wrapped.SetData(_vtk_arrays().numpy_to_vtk(np.ascontiguousarray(array), deep=True))
            return wrapped

        transform = vtkThinPlateSplineTransform()
        transform.SetBasisToR()
        transform.SetSourceLandmarks(points(problem.landmarks))
        transform.SetTargetLandmarks(points(problem.landmarks + problem.values))
        transform.Update()
        return transform, points(problem.grid.points)

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        from vtkmodules.vtkCommonCore import vtkPoints

        transform, nodes = fitted
        moved = vtkPoints()
        moved.SetDataTypeToDouble()
        transform.TransformPoints(nodes, moved)
        return moved, problem.grid.points

    def values(self, result: Any) -> NDArray[np.floating]:
        moved, nodes = result
        return _vtk_arrays().vtk_to_numpy(moved.GetData()) - nodes


def _vtk_arrays() -> Any:
    return import_module("vtkmodules.util.numpy_support")


class ITK(Contender):
    name = "ITK thin plate (R)"
    module = "itk"

    def unable(self, problem: Problem) -> str | None:
        slow = "its fit (3n unknowns by SVD) takes minutes" if problem.count > 400 else None
        return super().unable(problem) or slow

    def fit(self, problem: Problem) -> Any:
        import itk

        transform = itk.ThinPlateSplineKernelTransform[itk.D, 3].New()
        kind = type(transform.GetSourceLandmarks())

        def points(positions: Array) -> Any:
            points_set = kind.New()
            container = type(points_set.GetPoints()).New()
            for number, position in enumerate(positions):
                container.InsertElement(number, itk.Point[itk.D, 3](position.tolist()))
            points_set.SetPoints(container)
            return points_set

        transform.SetSourceLandmarks(points(problem.landmarks))
        transform.SetTargetLandmarks(points(problem.landmarks + problem.values))
        transform.ComputeWMatrix()
        return transform

    def evaluate(self, problem: Problem, fitted: Any) -> Any:
        import itk

        image = itk.Image[itk.Vector[itk.F, 3], 3]
        filter_ = itk.TransformToDisplacementFieldFilter[image, itk.D].New()
        filter_.SetTransform(fitted)
        filter_.SetSize(problem.grid.shape)
        filter_.SetOutputSpacing(problem.grid.spacing)
        filter_.Update()
        return filter_.GetOutput()

    def values(self, result: Any) -> NDArray[np.floating]:
        import itk

        return itk.array_from_image(result).transpose(2, 1, 0, 3).reshape(-1, 3)


OURS: tuple[Contender, ...] = (Ours("multilevel"), Ours("accurate"), Ours("direct32"), Ours("direct"))
PEERS: tuple[Contender, ...] = (SciPy(), VTK(), ITK(), KeOps(), Torch(), PaperStep())
