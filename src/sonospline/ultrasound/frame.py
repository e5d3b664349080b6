"""A grey image on a plane: read from a file, resliced, or rendered; and how a field deforms it."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._extras import require
from .._shown import lengths, size
from ..fields.field import Field
from ..fields.slices import draw_needle
from ..geometry import pose
from ..geometry.plane import ImagePlane
from ..io.canvas import axes_or_new
from ..io.files import regular_file
from ..io.png import png

if TYPE_CHECKING:
    from ..geometry.bent_needle import BentNeedle
    from ..geometry.needle import Needle
    from .colour_flow import ColourFlow

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """A grey image with its place in the world.

    Parameters
    ----------
    pixels : (rows, columns) ndarray
        Grey levels.
    plane : ImagePlane
        Where the pixels are.
    mask : (rows, columns) bool ndarray, optional
        Pixels that show something; the others (beyond the volume, outside the fan, never swept) are black.
    colour : ColourFlow, optional
        What colour Doppler shows over them.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.ultrasound import Frame
    >>> from sonospline.geometry import facing
    >>> frame = Frame.placed(np.zeros((400, 260), np.uint8), spacing_mm=0.1,
    ...                      probe_to_reference=facing((0, 0, 0), depth=(1, 0, 0), right=(0, 1, 0)))
    >>> [round(edge, 2) for edge in frame.plane.extent]
    [-13.0, 13.0, 39.95, -0.05]
    """

    pixels: NDArray[Any]
    plane: ImagePlane
    mask: NDArray[np.bool_] | None = None
    colour: ColourFlow | None = None

    def __post_init__(self) -> None:
        if np.shape(self.pixels) != self.plane.shape:
            raise ValueError(f"pixels has shape {np.shape(self.pixels)}; give {self.plane.shape}, as the plane")

    @classmethod
    def placed(
        cls,
        pixels: ArrayLike,
        *,
        spacing_mm: float | tuple[float, float],
        image_to_reference: ArrayLike | None = None,
        probe_to_reference: ArrayLike | None = None,
    ) -> Frame:
        """Return an image put on a plane, by one of two poses.

        Parameters
        ----------
        pixels : (rows, columns) array_like
            Grey levels.
        spacing_mm : float or (float, float)
            Distance between pixel centres, across and down.
        image_to_reference : (4, 4) array_like, optional
            Rigid pose of the centre of pixel (0, 0).
        probe_to_reference : (4, 4) array_like, optional
            Rigid pose of the middle of the probe's face, where the middle of the first row lies.

        Raises
        ------
        ValueError
            Not one grey image; both poses or none; a pose that is not rigid.
        """
        grey = np.asarray(pixels)
        if grey.ndim != 2 or grey.size == 0:
            raise ValueError(f"pixels has shape {grey.shape}; give one grey image of rows and columns")
        if (image_to_reference is None) == (probe_to_reference is None):
            raise ValueError("give image_to_reference (of pixel (0, 0)) or probe_to_reference, one of them")
        at: dict[str, Any] = {"shape": grey.shape, "spacing_mm": spacing_mm}
        if image_to_reference is not None:
            return cls(grey, ImagePlane(image_to_reference=np.asarray(image_to_reference), **at))
        width = np.ravel(spacing_mm)[0] * (grey.shape[1] - 1)
        face = pose.rigid("probe_to_reference", probe_to_reference)  # type: ignore[arg-type]  # one is given
        return cls(grey, ImagePlane.placed(face, corner_mm=(-width / 2, 0.0), **at))

    @classmethod
    def read(
        cls,
        path: str | PathLike[str],
        *,
        image_to_reference: ArrayLike | None = None,
        probe_to_reference: ArrayLike | None = None,
        spacing_mm: float | tuple[float, float] | None = None,
        index: int = 0,
    ) -> Frame:
        """Read one grey frame of an image file that SimpleITK knows (.mha, .png, ...), placed as :meth:`placed` does.

        Raises
        ------
        ValueError
            A file that cannot be read, and a file without pixel sizes (a spacing of exactly 1)
            where ``spacing_mm`` is not given; poses as :meth:`placed`.
        """
        path = regular_file(path, "frame", "the path of an image file")
        image = _read_picture(path)
        pixels = require("SimpleITK").GetArrayFromImage(image)
        if image.GetNumberOfComponentsPerPixel() != 1:
            raise ValueError(f"frame = {str(path)!r} is coloured; give a grey image")
        while pixels.ndim > 2:
            if not 0 <= index < len(pixels):
                raise ValueError(
                    f"index = {index} is beyond the {len(pixels)} frames of the file; give 0 to {len(pixels) - 1}"
                )
            pixels = pixels[index]
        calibrated = image.GetSpacing()[:2]
        if spacing_mm is None:
            if calibrated == (1.0, 1.0):
                raise ValueError(
                    f"frame = {str(path)!r} has no pixel size (its spacing is 1, 1); give spacing_mm, e.g. 0.1"
                )
            spacing_mm = calibrated
        return cls.placed(
            pixels,
            spacing_mm=spacing_mm,
            image_to_reference=image_to_reference,
            probe_to_reference=probe_to_reference,
        )

    def deform(self, field: Field) -> Frame:
        """Return the frame as it looks in the tissue that a field has deformed (Fig. 2 e-f).

        Each pixel shows what the inverse map brings there; what comes from beside the plane is
        taken from its foot on the plane, for one frame knows no more. What comes from beyond the
        frame is black and masked.
        """
        from scipy.ndimage import map_coordinates

        with np.errstate(invalid="ignore"):
            source = field.inverse(self.plane.points)
            flat = pose.to_image(self.plane.image_to_reference, source)
        index = flat[:, :2] / self.plane.spacing_mm
        known = np.isfinite(index).all(axis=1)
        columns, rows = np.nan_to_num(index, nan=-1.0).T
        last_row, last_column = np.array(self.pixels.shape) - 1
        known &= (rows >= -0.5) & (rows <= last_row + 0.5) & (columns >= -0.5) & (columns <= last_column + 0.5)
        grey = map_coordinates(self.pixels.astype(np.float32), [rows, columns], order=1, mode="nearest")
        mask = known.reshape(self.pixels.shape)
        if self.mask is not None:
            nearest = np.rint([np.clip(rows, 0, last_row), np.clip(columns, 0, last_column)]).astype(int)
            mask = mask & self.mask[nearest[0], nearest[1]].reshape(mask.shape)
        pixels = np.where(mask, grey.reshape(mask.shape), 0)
        if np.issubdtype(self.pixels.dtype, np.integer):
            pixels = np.rint(pixels)
        return replace(self, pixels=pixels.astype(self.pixels.dtype), mask=mask, colour=None)

    def plot(self, ax: Any = None, *, needle: Needle | BentNeedle | None = None, **style: Any) -> Any:
        """Draw the image in mm, depth downwards, on matplotlib ``Axes``; return them."""
        ax = axes_or_new(ax)
        ax.imshow(self.shown, origin="upper", extent=self.plane.extent, **({"cmap": "gray"} | style))
        if self.colour is not None:
            self.colour.draw_on(ax)
        ax.set_xlabel("mm")
        ax.set_ylabel("mm")
        if needle is not None:
            draw_needle(ax, self.plane, needle)
        return ax

    def _repr_png_(self) -> bytes:
        """The picture as a notebook shows it."""
        return png(as_bytes(self.shown))

    @property
    def shown(self) -> NDArray[Any]:
        """The picture (rows, columns), with the colours of Doppler on it (rows, columns, 3) where there are any."""
        return self.pixels if self.colour is None else self.colour.over(as_bytes(self.pixels))

    def __repr__(self) -> str:
        return f"Frame({size(self.pixels.shape)} pixels, {lengths(self.plane.spacing_mm)}, {self.pixels.dtype})"

    def save(self, path: str | PathLike[str]) -> None:
        """Write a picture (.png) or an image with its geometry (.mha, .nrrd, ...: one slice, LPS)."""
        from ..io.volumes import RAS_TO_LPS
        from ..io.writing import write_image

        sitk = require("SimpleITK")
        if Path(path).suffix == ".png":
            write_image(sitk.GetImageFromArray(as_bytes(self.shown), isVector=self.colour is not None), path)
            return
        image = sitk.GetImageFromArray(np.ascontiguousarray(self.pixels)[None])
        image.SetSpacing((*self.plane.spacing_mm, float(min(self.plane.spacing_mm))))
        image.SetOrigin((RAS_TO_LPS @ self.plane.affine[:, 2]).tolist())
        image.SetDirection((RAS_TO_LPS @ self.plane.image_to_reference[:3, :3]).ravel().tolist())
        write_image(image, path)


def _read_picture(path: Path) -> Any:
    """An image of any type SimpleITK reads, as its own."""
    from ..io.headers import SUFFIXES
    from ..io.volumes import read_image

    if path.name.lower().endswith(SUFFIXES):
        return read_image(path, "frame")
    try:
        return require("SimpleITK").ReadImage(str(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise ValueError(f"frame = {str(path)!r} cannot be read ({reason}); give a grey image") from None


def as_bytes(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    """Return grey levels as 8-bit; those of other types are scaled from their own black to their white."""
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels)
    known = pixels[np.isfinite(pixels)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return np.nan_to_num(255 * (np.clip(pixels, low, high) - low) / max(high - low, 1e-12)).astype(np.uint8)
