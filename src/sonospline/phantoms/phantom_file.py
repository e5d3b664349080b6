"""A phantom from files: a label map, and what its labels are to ultrasound."""

from __future__ import annotations

from os import PathLike

from ..io.labels import labels_named, read_labels
from ..io.tables import read_names
from ..io.volumes import read_volume
from ..ultrasound.acoustics import read_table
from ..ultrasound.organs import LARGEST_ORGAN, phantom_from_organs
from ..ultrasound.phantom import LARGEST_LABEL, Phantom

Path = str | PathLike[str]


def read_phantom(
    labels: Path, *, table: Path | None = None, names: Path | None = None, ct: Path | None = None
) -> Phantom:
    """Read a phantom.

    Parameters
    ----------
    labels : path-like
        Its label map.
    table : path-like, optional
        CSV of the acoustic properties of each label, see :func:`~sonospline.ultrasound.acoustics.read_table`.
    names : path-like, optional
        CSV of organ names instead, see :func:`~sonospline.ultrasound.organs.phantom_from_organs`.
    ct : path-like, optional
        CT of the same patient, for voxels without a label; with ``names``.

    Raises
    ------
    ValueError
        A file that cannot be read, a label without properties, or not just one of ``table`` and ``names``.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.phantoms.phantom_file import read_phantom
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     voxels = np.full((8, 8, 8), 5, np.uint8)
    ...     ss.write_volume(ss.Volume(voxels=voxels, spacing=(1, 1, 1)), folder + "/organs.nrrd")
    ...     _ = Path(folder, "names.csv").write_text("label,name\\n5,liver\\n")
    ...     read_phantom(folder + "/organs.nrrd", names=folder + "/names.csv").labels.voxels.shape
    (8, 8, 8)
    """
    if table is not None and names is None:
        label_map, properties = read_labels(labels, largest=LARGEST_LABEL), read_table(table)
        with labels_named(labels):
            return Phantom(label_map, properties)
    if names is None or table is not None:
        raise ValueError("a phantom needs table (acoustic properties) or names (organ names), one of them")
    organs, organ_names = read_labels(labels, largest=LARGEST_ORGAN), read_names(names)
    scan = None if ct is None else read_volume(ct, name="ct")
    with labels_named(labels):
        return phantom_from_organs(organs, organ_names, ct=scan)
