"""The deformation field: what images, forces and files see, whoever made it."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from os import PathLike
from typing import Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import lengths, size
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..io.volumes import vector_image

Array = NDArray[np.float64]
Method = Literal["auto", "multilevel", "accurate", "direct32", "direct"]
METHODS = ("auto", "multilevel", "accurate", "direct32", "direct")

logger = logging.getLogger(__name__)


class InverseReport(NamedTuple):
    """How an inverse map was found."""

    converged: NDArray[np.bool_]
    """(m,) points whose inverse is known; the others are NaN."""
    iterations: int
    """Fixed-point iterations made."""
    residual: float
    """Largest ``|forward(inverse(p)) - p|`` over the converged points."""


class Field(ABC):
    """A displacement field u(x) of tissue, in world coordinates of the undeformed body.

    ``forward`` maps undeformed to deformed positions, x + u(x); ``inverse`` maps back.
    """

    grid: Grid | None
    """The lattice of :meth:`on_grid`."""
    inverse_tolerance = 1e-9
    """Default tolerance of :meth:`inverse`, in units of the field's length."""
    error_estimate: float | None = None
    """Error relative to the field itself, where its maker knows it: an unfinished elastic solution does."""

    @abstractmethod
    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3); (3,) at one point (3,), and alike in every map."""

    @abstractmethod
    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, I + du_a/dx_b, at points (m, 3); (3, 3) at one."""

    @abstractmethod
    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3).

        Parameters
        ----------
        method : str, default: "auto"
            ``"auto"`` takes the cheapest way that errs by at most 1e-5 of the side.
            ``"multilevel"`` needs U = r and landmarks on nodes; its cost hardly depends on
            their number. ``"accurate"`` is the same to 1e-6. Where they do not apply, the
            direct sum takes their place. ``"direct32"`` sums in float32: 3e-7 for U = r,
            1e-5 for r^3, whose terms cancel. ``"direct"`` sums in float64, the reference.
        """

    def forward(self, points: ArrayLike) -> Array:
        """Return the deformed positions x + u(x) (m, 3) of world points (m, 3), eq. (8); (3,) of one."""
        x, shape = _validate.rows("points", points)
        return (x + self.displacement(x)).reshape(*shape, 3)

    @overload
    def inverse(self, points: ArrayLike, *, tolerance: float | None = ..., max_iterations: int = ...) -> Array: ...
    @overload
    def inverse(
        self,
        points: ArrayLike,
        *,
        tolerance: float | None = ...,
        max_iterations: int = ...,
        return_report: Literal[True],
    ) -> tuple[Array, InverseReport]: ...

    def inverse(
        self,
        points: ArrayLike,
        *,
        tolerance: float | None = None,
        max_iterations: int = 100,
        return_report: bool = False,
    ) -> Array | tuple[Array, InverseReport]:
        """Return the undeformed positions x (m, 3) with x + u(x) = p, for world points p (m, 3); (3,) for one.

        Fixed-point iteration x <- p - u(x), which contracts while ``|grad u| < 1``. A point
        that does not converge is NaN, never a guess, and is counted in the log.

        Parameters
        ----------
        points : (m, 3) or (3,) array_like
            Deformed positions.
        tolerance : float, optional
            Largest ``|x + u(x) - p|`` accepted; by default ``inverse_tolerance`` of the field's length.
        max_iterations : int, default: 100
            Iterations before a point is given up.
        return_report : bool, default: False
            Also return an :class:`InverseReport`.

        Examples
        --------
        >>> import numpy as np, sonospline as ss
        >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(13)))
        >>> field = insertion.advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
        >>> p = (.4, .45, .5)
        >>> bool(np.allclose(field.inverse(field.forward(p)), p, atol=1e-8))
        True
        """
        target, shape = _validate.rows("points", points)
        _validate.count("max_iterations", max_iterations)
        default = self.inverse_tolerance * self.length
        limit = default if tolerance is None else _validate.number("tolerance", tolerance, positive=True)
        x, report = self._find_inverse(target, limit, max_iterations)
        if not report.converged.all():
            logger.warning("inverse map: %d of %d points did not converge", (~report.converged).sum(), len(x))
        x = x.reshape(*shape, 3)
        return (x, report._replace(converged=report.converged.reshape(shape))) if return_report else x

    def _find_inverse(self, target: Array, tolerance: float, max_iterations: int) -> tuple[Array, InverseReport]:
        x, remaining = target.copy(), np.arange(len(target))
        residual, iterations = 0.0, 0
        while len(remaining) and iterations < max_iterations:
            iterations += 1
            missing = target[remaining] - self.forward(x[remaining])
            size = np.linalg.norm(missing, axis=1)
            done = size <= tolerance
            residual = max(residual, float(size[done].max(initial=0.0)))
            x[remaining[~done]] += missing[~done]
            # A point sent far outside is lost; stop before it overflows.
            lost = ~done & (size > 10 * self.length)
            x[remaining[lost]] = np.nan
            remaining = remaining[~done & ~lost]
        x[remaining] = np.nan
        return x, InverseReport(np.logical_and.reduce(np.isfinite(x), axis=1), iterations, residual)

    def plot(
        self, ax: Any = None, *, through: Needle | ArrayLike | None = None, normal: ArrayLike | None = None,
        **style: Any,
    ) -> Any:  # fmt: skip
        """Draw a slice of the deformed tissue on matplotlib ``Axes``: how far it moved, and arrows, in mm.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; by default on a new figure.
        through : Needle or (3,) array_like, optional
            What the slice contains: a needle, along the picture's x, or a point; by default the place that
            moves most.
        normal : (3,) array_like, optional
            World direction the slice is seen along; by default the lattice axis most across the needle.
        **style
            As :meth:`sonospline.fields.PlaneSlice.plot` takes it: ``arrows``, ``lines_mm``, ``colour_bar``.

        Returns
        -------
        matplotlib Axes

        Examples
        --------
        >>> import sonospline as ss
        >>> needle = ss.Needle((0, .5, .5), (.5, .5, .5))
        >>> field = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(13))).advance(needle)
        >>> axes = field.plot(through=needle)  # axes.figure.savefig("slice.png")
        """
        from .slices import plot_slice

        return plot_slice(self, ax, through, normal, style)

    def to_sitk(self) -> Any:
        """Return a SimpleITK ``DisplacementFieldTransform`` that warps images: the inverse map, LPS.

        ``SimpleITK.Resample(image, field.to_sitk())`` is the image of the deformed tissue, for ITK asks a
        transform where each point of its output came from. :meth:`to_sitk_image` has the forward displacement.

        Examples
        --------
        >>> import sonospline as ss
        >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(13)))
        >>> field = insertion.advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
        >>> p = field.to_sitk().TransformPoint((-.5, -.5, .5))  # LPS
        >>> [round(x, 3) for x in p] == [round(x, 3) for x in field.inverse((.5, .5, .5)) * (-1, -1, 1)]
        True
        """
        from .image_warp import ImageWarp

        return ImageWarp.of(self).to_sitk()

    def to_sitk_image(self) -> Any:
        """Return the forward displacement at the grid's nodes as a SimpleITK vector image, LPS mm."""
        return vector_image(self._require_grid(), self.on_grid())

    def to_pyvista(self) -> Any:
        """Return the grid as PyVista's, with point arrays ``displacement`` (vectors, mm) and ``det J``.

        An ``ImageData`` where the lattice lies along the world's axes, else a ``StructuredGrid``; positions are
        RAS. ``mesh.warp_by_vector("displacement")`` is the deformed tissue. Needs the extra ``view``.
        """
        from .export import mesh

        return mesh(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the field to a file; the suffix says what for.

        =================  ===============================================================================
        ``.h5``, ``.tfm``  ITK transform that warps images, as :meth:`to_sitk`; LPS
        ``.nrrd, .mha``    forward displacement as a vector image; LPS
        ``.vti``           forward displacement and det J, for ParaView; LPS, and says so
        ``.npz``           ``displacement`` (nx, ny, nz, 3), ``spacing``, ``origin``, ``direction``; RAS
        =================  ===============================================================================

        Raises
        ------
        ValueError
            Another suffix, or a field without a grid.
        OSError
            The file could not be written whole.

        Examples
        --------
        >>> import sonospline as ss
        >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(13)))
        >>> field = insertion.advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
        >>> field.save("u.h5")
        >>> field.save("u.xyz")
        Traceback (most recent call last):
        ValueError: path = 'u.xyz' is of an unknown file type; use one of .h5, .tfm, .nrrd, .mha, .vti, .npz
        """
        from .export import save

        save(self, path)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._facts())})"

    def _facts(self) -> list[str]:
        """What its text says."""
        return ["no grid"] if self.grid is None else [size(self.grid.shape), lengths(self.grid.spacing)]

    def det_jacobian(self) -> Array:
        """Return det J at every node of the grid, as (nx, ny, nz); at or below zero the tissue folds over."""
        grid = self._require_grid()
        return np.linalg.det(self.jacobian(grid.points)).reshape(grid.shape)

    def smallest_jacobian(self) -> float:
        """Return the smallest det J over the grid's nodes; at or below zero the tissue folds over."""
        return float(self.det_jacobian().min())

    @property
    @abstractmethod
    def length(self) -> float:
        """The length that errors of this field are measured in: the side of its box."""

    def _require_grid(self) -> Grid:
        if self.grid is None:
            raise ValueError("grid = None: this field knows no grid; pass grid= where it is fitted")
        return self.grid
