"""Scenes of 3D Slicer: nodes of MRML and the files beside them, as one bundle (``.mrb``) or in a folder."""

from __future__ import annotations

import gzip
import zipfile
from collections import Counter
from collections.abc import Mapping
from io import BytesIO
from os import PathLike
from pathlib import Path
from urllib.parse import quote
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from .writing import write_bytes

_CLASSES = {"Volume": "ScalarVolume", "VolumeDisplay": "ScalarVolumeDisplay"}
"""Nodes whose class is called otherwise than their tag."""
_SINGLETONS = ("Slice", "SliceComposite")


class Mrml:
    """A scene as it is put together.

    Examples
    --------
    >>> from sonospline.io.mrml import Mrml
    >>> scene = Mrml()
    >>> scene.add("LinearTransform", "ProbeToReference")
    'vtkMRMLLinearTransformNode1'
    >>> scene.add("Model", "needle", references={"transform": "vtkMRMLLinearTransformNode1"})
    'vtkMRMLModelNode1'
    """

    def __init__(self) -> None:
        self._nodes: list[str] = []
        self._count: Counter[str] = Counter()
        self.files: dict[str, bytes] = {}
        """What nodes are stored in, by name."""

    def add(
        self,
        tag: str,
        name: str,
        *,
        references: Mapping[str, str] | None = None,
        attributes: Mapping[str, str] | None = None,
        **fields: object,
    ) -> str:
        """Add a node and return its id.

        Parameters
        ----------
        tag : str
            As MRML has it: ``Model``, ``LinearTransform``, ...
        name : str
        references : mapping of str to str, optional
            Ids of other nodes (several parted by blanks), by role.
        attributes : mapping of str to str, optional
            What modules keep at a node: ``VolumeResliceDriver.Driver``.
        **fields
            Its own: numbers, texts, matrices.
        """
        kind = f"vtkMRML{_CLASSES.get(tag, tag)}Node"
        self._count[kind] += 1
        id_ = f"{kind}{fields['singletonTag'] if tag in _SINGLETONS else self._count[kind]}"
        parts = {"id": id_, "name": name}
        if references:
            parts["references"] = "".join(f"{role}:{target};" for role, target in references.items())
        if attributes:
            parts["attributes"] = ";".join(f"{_escaped(key)}:{_escaped(value)}" for key, value in attributes.items())
        parts |= {key: _text(value) for key, value in fields.items()}
        self._nodes.append(f"  <{tag} {' '.join(f'{key}={quoteattr(value)}' for key, value in parts.items())}></{tag}>")
        return id_

    def stored(self, tag: str, file: str, content: bytes) -> str:
        """Add a storage node of a file, keep the file, and return the node's id."""
        self.files[file] = content
        return self.add(tag, f"storage of {file}", hideFromEditors=True, fileName=f"Data/{quote(file)}")

    @property
    def nodes(self) -> int:
        """How many there are."""
        return len(self._nodes)

    def text(self) -> str:
        """Return the scene's file."""
        nodes = "\n".join(self._nodes)
        return f'<?xml version="1.0" encoding="UTF-8"?>\n<MRML version="Slicer 5.10.0" userTags="">\n{nodes}\n</MRML>\n'

    def write(self, path: str | PathLike[str]) -> None:
        """Write it as a bundle; ``OSError`` where not all of it arrives.

        Raises
        ------
        ValueError
            A path that does not end in ``.mrb``.
        """
        path = Path(path)
        if path.suffix != ".mrb":
            raise ValueError(f"path = {str(path)!r} does not end in .mrb; give one that does")
        bundle = BytesIO()
        with zipfile.ZipFile(bundle, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in ((f"{path.stem}.mrml", self.text().encode()), *self._data()):
                archive.writestr(zipfile.ZipInfo(f"{path.stem}/{name}"), content, zipfile.ZIP_DEFLATED)
        write_bytes(path, bundle.getvalue())

    def write_folder(self, folder: str | PathLike[str], name: str = "scene") -> None:
        """Write it as ``name.mrml`` with the folder ``Data`` beside it."""
        folder = Path(folder)
        (folder / "Data").mkdir(parents=True, exist_ok=True)
        for file, content in (*self._data(), (f"{name}.mrml", self.text().encode())):
            write_bytes(folder / file, content)

    def _data(self) -> list[tuple[str, bytes]]:
        return [(f"Data/{quote(name)}", content) for name, content in self.files.items()]

    def __repr__(self) -> str:
        return f"Mrml({len(self._nodes)} nodes, {len(self.files)} files)"


def nrrd_bytes(voxels: NDArray[np.generic], ijk_to_ras: NDArray[np.floating]) -> bytes:
    """Return voxels (k, j, i) of 8 bits, one slice or more, as a NRRD file."""
    axes = " ".join(f"({','.join(f'{x:.9g}' for x in axis)})" for axis in ijk_to_ras[:3, :3].T)
    lines = [
        "NRRD0004", "type: uint8", "dimension: 3", "space: right-anterior-superior",
        f"sizes: {' '.join(map(str, voxels.shape[::-1]))}", f"space directions: {axes}",
        "kinds: domain domain domain", "encoding: gzip",
        f"space origin: ({','.join(f'{x:.9g}' for x in ijk_to_ras[:3, 3])})",
    ]  # fmt: skip
    data = gzip.compress(np.ascontiguousarray(voxels, np.uint8).tobytes(), mtime=0)
    return "\n".join(lines).encode() + b"\n\n" + data


def polydata_bytes(points: NDArray[np.floating], triangles: NDArray[np.integer]) -> bytes:
    """Return a surface as a legacy VTK file that says it is in RAS, as 3D Slicer reads it."""
    cells = np.hstack([np.full((len(triangles), 1), triangles.shape[1]), triangles]).astype(">i4")
    head = f"# vtk DataFile Version 3.0\nSonospline SPACE=RAS\nBINARY\nDATASET POLYDATA\nPOINTS {len(points)} float\n"
    middle = f"\nPOLYGONS {len(cells)} {cells.size}\n"
    return head.encode() + points.astype(">f4").tobytes() + middle.encode() + cells.tobytes() + b"\n"


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace(";", "%3B").replace(":", "%3A")


def _text(value: object) -> str:
    if isinstance(value, np.ndarray):
        return " ".join(f"{x:.9g}" for x in value.ravel())
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)
