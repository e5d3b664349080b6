"""The mesh-free middle way: a matrix-valued elastic kernel, and an insertion that drags by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import _core, _definite, _memory, _validate
from ...fields.field import Field, Method
from ...fields.grid_field import GridField
from ...geometry.grid import Grid
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ..spline.insertion import NeedleInsertion
from ..spline.landmarks import select_anchors

Array = NDArray[np.float64]

_BLOCK = 60_000
"""Pairs of points and centres held at once: few enough to stay in the cache."""
_NODES_PER_WIDTH = 2.5
"""Of the lattice a field is kept on: cubics between them are good to 3e-4 of the peak."""
_LARGEST_DRAG = 1e3
"""In sides of the tissue."""
_MOST_ENERGY = 2.0
"""Of a shaft's forces, in that of one force that moves its place by the drag, for each width of the shaft and one
more; poses of the default kernel need 1.6. A displacement is at most the root of energy times compliance."""


@dataclass(frozen=True)
class Kelvinlet:
    """Displacement of unbounded elastic tissue by a force spread over a ball: a regularised Kelvin solution.

    With r_e^2 = r^2 + eps^2, a = 1 / (4 pi mu) and b = a / (4 (1 - nu)),

        K(x) = [ (a - b) / r_e + a eps^2 / (2 r_e^3) ] I + (b / r_e^3) x x^T

    for mu = 1. A symmetric, positive definite 3 x 3 kernel: an interpolant of displacements
    needs neither an affine part nor smoothing.

    Parameters
    ----------
    poissons_ratio : float, default: 0.45
        nu, at or above zero and below 0.5.
    width : float, default: 0.1
        eps, in the unit of the grid. Above zero.

    References
    ----------
    F. de Goes and D. L. James, Regularized Kelvinlets, ACM Trans. Graph. 36 (2017) 40.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> kernel = ss.Kelvinlet(width=0.1)
    >>> matrix = kernel.matrix(np.eye(3), np.eye(3))
    >>> matrix.shape, bool(np.linalg.eigvalsh(matrix).min() > 0)
    ((9, 9), True)
    """

    poissons_ratio: float = 0.45
    width: float = 0.1

    def __post_init__(self) -> None:
        ratio = _validate.number("poissons_ratio", self.poissons_ratio)
        if ratio >= 0.5:
            raise ValueError(f"poissons_ratio = {ratio:g} is out of range; give less than 0.5, e.g. 0.45")
        object.__setattr__(self, "width", _validate.number("width", self.width, positive=True))

    @property
    def compliance(self) -> float:
        """Displacement where a unit force acts, K(0)."""
        return float(self._radial(np.zeros(1))[0][0])

    def matrix(self, points: Array, centres: Array) -> Array:
        """Return K(p_i - c_j) as a (3m, 3n) matrix, components of a point together."""
        apart = points[:, None] - centres
        isotropic, axial, _ = self._radial((apart**2).sum(axis=-1))
        blocks = (
            isotropic[..., None, None] * np.eye(3) + axial[..., None, None] * apart[..., None] * apart[..., None, :]
        )
        return blocks.transpose(0, 2, 1, 3).reshape(3 * len(points), 3 * len(centres))

    def sum(self, points: Array, centres: Array, forces: Array) -> Array:
        """Return sum_j K(p_i - c_j) f_j at points (m, 3), as (m, 3)."""
        return _core.active.kelvinlet_sum(points, centres, forces, self.width, self.poissons_ratio)

    def gradient(self, points: Array, centres: Array, forces: Array) -> Array:
        """Return d u_a / d x_b of the same sum at points (m, 3), as (m, 3, 3)."""
        out = np.empty((len(points), 3, 3))
        rows = max(1, _BLOCK // (9 * max(1, len(centres))))
        for start in range(0, len(points), rows):
            apart = points[start : start + rows, None] - centres
            root2 = (apart**2).sum(axis=-1) + self.width**2
            _, axial, slope = self._radial(root2 - self.width**2)
            along = np.einsum("ija,ja->ij", apart, forces)
            block = np.einsum("ij,ja,ijb->iab", slope, forces, apart)
            block += np.einsum("ij,ija,jb->iab", axial, apart, forces)
            block += np.eye(3) * np.einsum("ij,ij->i", axial, along)[:, None, None]
            block -= np.einsum("ij,ija,ijb->iab", 3 * axial / root2 * along, apart, apart)
            out[start : start + rows] = block
        return out

    def _radial(self, squared: Array) -> tuple[Array, Array, Array]:
        """Factors of I and of x x^T, and the derivative of the first by r over r."""
        a = 1 / (4 * np.pi)
        b = a / (4 * (1 - self.poissons_ratio))
        root = 1 / np.sqrt(squared + self.width**2)
        cube = root**3
        isotropic = (a - b) * root + 0.5 * a * self.width**2 * cube
        slope = -(a - b) * cube - 1.5 * a * self.width**2 * cube * root**2
        return isotropic, b * cube, slope


@dataclass(frozen=True, eq=False)
class KelvinletField(Field):
    """A sum of Kelvinlets, ``u(x) = sum_j K(x - c_j) f_j``."""

    kernel: Kelvinlet
    centres: Array
    forces: Array
    grid: Grid

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3)."""
        return self.kernel.sum(_validate.points("points", points), self.centres, self.forces)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, analytic."""
        return np.eye(3) + self.kernel.gradient(_validate.points("points", points), self.centres, self.forces)

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3)."""
        return self.displacement(self.grid.points).reshape(*self.grid.shape, 3)

    @property
    def length(self) -> float:
        """Side of the grid."""
        return self.grid.side


@dataclass(frozen=True, kw_only=True)
class DragModel:
    """How the needle drags homogeneous tissue: one displacement along the whole shaft.

    Parameters
    ----------
    drag : float
        Displacement of tissue at the shaft, along the needle. At or above zero.
    spacing : float
        Distance of landmarks along the shaft. Above zero.
    kernel : Kelvinlet
        How the tissue around follows.

    Examples
    --------
    >>> import sonospline as ss
    >>> ss.DragModel.kelvinlet(side=100).kernel.width
    10.0
    """

    drag: float
    spacing: float
    kernel: Kelvinlet

    def __post_init__(self) -> None:
        object.__setattr__(self, "drag", _validate.number("drag", self.drag))
        object.__setattr__(self, "spacing", _validate.number("spacing", self.spacing, positive=True))

    @classmethod
    def kelvinlet(cls, side: float = 1.0, *, drag: float | None = None, poissons_ratio: float = 0.45) -> DragModel:
        """Return the model for a cube of a side.

        The default drag is the one that least squares finds for load case F on the three
        tuning insertions; it is linear in load over stiffness.
        """
        side = _validate.number("side", side, positive=True)
        chosen = DRAG * side if drag is None else drag
        return cls(drag=chosen, spacing=0.04 * side, kernel=Kelvinlet(poissons_ratio, 0.1 * side))


DRAG = 0.0279
"""In cube sides, for load case F."""


class KelvinletInsertion(NeedleInsertion):
    """A needle insertion into homogeneous tissue without a mesh: landmarks on the axis, zeros on the faces.

    Tissue nearer to a pinned face than the kernel's width follows the needle less, in
    proportion to its distance: at the face, where it is held, not at all. With the kernel of
    :meth:`DragModel.kelvinlet` no tissue moves by more than 1.2 times the drag; a kernel may be so
    wide that its forces would fight the anchors, and their energy is limited to twice that of a
    force for every width of the shaft, which keeps displacements below
    drag sqrt(2 (1 + depth / width)).

    Parameters
    ----------
    tissue : Tissue
        Where the needle goes.
    model : DragModel, optional
        Its effect; by default :meth:`DragModel.kelvinlet` of the grid's side.
    anchors : int, default: 7
        Anchors along each side of a pinned face: 7 x 7 a face are 193 on a cube.

    Raises
    ------
    ValueError
        Anchors so much nearer to one another than the kernel is wide that their forces cannot be told apart.

    Examples
    --------
    >>> import sonospline as ss
    >>> insertion = ss.KelvinletInsertion(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> field = insertion.advance(ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5)))
    >>> bool(0.02 < abs(field.on_grid()).max() < 0.03)
    True
    """

    def __init__(self, tissue: Tissue, model: DragModel | None = None, *, anchors: int = 7) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {tissue!r} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(53))")
        self.tissue = tissue
        self.model = DragModel.kelvinlet(tissue.grid.side) if model is None else model
        if self.model.drag > _LARGEST_DRAG * tissue.grid.side:
            raise ValueError(
                f"drag = {self.model.drag:g} is far beyond the tissue's side of {tissue.grid.side:g}; give a part of it"
            )
        self.anchors = select_anchors(tissue, _validate.count("anchors", anchors, least=2))
        self._factor, condition = _definite.factor(self.model.kernel.matrix(self.anchors, self.anchors))
        if condition < _definite.SMALLEST_CONDITION:
            raise ValueError(
                f"anchors = {anchors} along each side are too near to one another for the kernel's width = "
                f"{self.model.kernel.width:g} (reciprocal condition {condition:.1e}); give fewer, or a narrower kernel"
            )
        self._lattice = _lattice(tissue.grid, self.model.kernel.width)
        self.reset()

    def reset(self) -> None:
        """Take the needle out and let the tissue return to its undeformed state."""
        self.landmark_count = 0
        zeros = np.zeros((*self._lattice.shape, 3), np.float32)
        self.field: Field = GridField(self.tissue.grid, zeros, lattice=self._lattice, order=3)

    def advance(self, needle: Needle) -> GridField:
        """Move the needle to a pose and return the field it leaves, cubic on a lattice of the kernel's width.

        Raises
        ------
        ValueError
            A needle outside the tissue.
        """
        exact = self.solve(needle)
        values = exact.displacement(self._lattice.points).reshape(*self._lattice.shape, 3)
        self.field = GridField(self.tissue.grid, values.astype(np.float32), lattice=self._lattice, order=3)
        self.landmark_count = len(exact.centres) - len(self.anchors)
        return self.field

    def solve(self, needle: Needle) -> KelvinletField:
        """Return the exact sum of Kelvinlets for a pose."""
        from scipy.linalg import cho_solve

        self.tissue.check_inside(entry=needle.entry, tip=needle.tip)
        kernel = self.model.kernel
        landmarks = needle.depth / self.model.spacing
        dense = f"the model's spacing = {self.model.spacing:g}: the system of its {landmarks:.3g} landmarks"
        _memory.refuse_beyond(int(min(250 * landmarks**2, 1e30)), dense, remedy="use a wider one")
        shaft = needle.at(np.linspace(0, 1, int(np.ceil(needle.depth / self.model.spacing)) + 1))
        follows = np.minimum(self.tissue.distance_to_pinned(shaft) / kernel.width, 1.0)
        wanted = np.outer(follows, self.model.drag * needle.direction).ravel()
        # Anchors do not move: they leave the system by a Schur complement, their factor is kept.
        across = kernel.matrix(self.anchors, shaft)
        answer = cho_solve((self._factor, True), across)
        most = _MOST_ENERGY * (1 + needle.depth / kernel.width) * self.model.drag**2 / kernel.compliance
        on_shaft = _definite.solve(kernel.matrix(shaft, shaft) - across.T @ answer, wanted, most=most)
        forces = np.concatenate([-answer @ on_shaft, on_shaft]).reshape(-1, 3)
        return KelvinletField(kernel, np.concatenate([self.anchors, shaft]), forces, self.tissue.grid)


def _lattice(grid: Grid, width: float) -> Grid:
    """The nodes that a field of kernels of a width is kept on, over a grid's box."""
    cells = grid.extent * _NODES_PER_WIDTH / width
    wanted = int(min(40 * float(np.prod(cells + 2)), 1e30))
    _memory.refuse_beyond(wanted, f"the kernel's width = {width:g}: its lattice", remedy="use a wider kernel")
    cells = np.ceil(cells).astype(int) + 1
    return Grid(
        shape=(int(cells[0]) + 1, int(cells[1]) + 1, int(cells[2]) + 1),
        spacing=tuple(grid.extent / cells),
        origin=grid.origin,
        direction=grid.direction,
    )
