"""The deformation field: what images, forces and files see, whoever made it."""

from __future__ import annotations

from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from ..geometry.needle import Needle
from ..io.volumes import vector_image
from .maps import FieldMaps


class Field(FieldMaps):
    """A displacement field u(x) of tissue: its maps, and its pictures and files.

    ``forward`` maps undeformed to deformed positions, x + u(x); ``inverse`` maps back. A field of your own gives
    ``displacement``, ``jacobian``, ``on_grid``, ``length`` and ``grid``.
    """

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
        return vector_image(self.require_grid(), self.on_grid())

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
