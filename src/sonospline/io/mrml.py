"""Scenes of 3D Slicer: nodes of MRML and the files beside them, as one bundle (``.mrb``) or in a folder."""

from __future__ import annotations

import gzip
import json
import zipfile
from collections import Counter
from collections.abc import Mapping
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .headers.nrrd import type_name
from .markups import SUFFIX, markups_content
from .writing import write_bytes

_CLASSES = {"Volume": "ScalarVolume", "VolumeDisplay": "ScalarVolumeDisplay"}
"""Nodes whose class is called otherwise than their tag."""
_SINGLETONS = ("Slice", "SliceComposite")
GREY = "vtkMRMLColorTableNodeGrey"
FOUR_UP = 3
"""3D Slicer's number for the layout with three slices and a view in 3-D."""


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
        # The file's name is quoted, as 3D Slicer does it, and in the scene once more, as any name there.
        return self.add(tag, f"storage of {file}", hideFromEditors=True, fileName=f"Data/{quote(quote(file))}")

    def shown(
        self,
        tag: str,
        name: str,
        file: tuple[str, str, bytes],
        references: Mapping[str, str] | None = None,
        **display: Any,
    ) -> str:
        """Add a node that is drawn, from a file, and return its id.

        Parameters
        ----------
        tag, name : str
            As of :meth:`add`; its display node is the tag's.
        file : (str, str, bytes)
            The storage node's tag, the file's name, and what is in it.
        references : mapping of str to str, optional
            Other nodes: ``transform``.
        **display
            How it is drawn.
        """
        stored = self.stored(*file)
        drawn = self.add(f"{tag}Display", f"{name} display", hideFromEditors=True, **display)
        return self.add(tag, name, references={"display": drawn, "storage": stored, **(references or {})})

    def surface(
        self,
        name: str,
        points: NDArray[np.floating],
        triangles: NDArray[np.integer],
        colour: str,
        opacity: float = 1.0,
        references: Mapping[str, str] | None = None,
    ) -> str:
        """Add a model and return its id; the colour as ``#rrggbb``."""
        rgb = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        return self.shown(
            "Model", name, ("ModelStorage", f"{name}.vtk", polydata_bytes(points, triangles)), references,
            opacity=opacity, visibility=True, visibility2D=True, backfaceCulling=False, color=rgb,
        )  # fmt: skip

    def fiducials(self, name: str, points: Mapping[str, ArrayLike], references: Mapping[str, str] | None = None) -> str:
        """Add points with labels, RAS mm, and return their node's id."""
        data = json.dumps(markups_content(points)).encode()
        file = ("MarkupsJsonStorage", f"{name}{SUFFIX}", data)
        return self.shown("MarkupsFiducial", name, file, references, glyphScale=2)

    def slice_view(self, view: str, slice_to_world: NDArray[np.floating], image: str = "", **more: Any) -> None:
        """Show an image, if any, in the view Red, Yellow or Green, on a plane; ``more`` is of its slice node."""
        self.add("Slice", view, singletonTag=view, layoutName=view, sliceToRAS=slice_to_world, **more)
        self.add(
            "SliceComposite", "SliceComposite", singletonTag=view, layoutName=view, hideFromEditors=True,
            references={"backgroundVolume": image} if image else None,
        )  # fmt: skip

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


def nrrd_bytes(voxels: NDArray[np.generic], ijk_to_ras: NDArray[np.floating], level: int = 9) -> bytes:
    """Return voxels (k, j, i), one slice or more, as a NRRD file, compressed at a level of gzip's.

    Voxels of a type that NRRD has none for become doubles.
    """
    kind = voxels.dtype if type_name(voxels.dtype) else np.dtype(np.float64)
    axes = " ".join(f"({','.join(f'{x:.9g}' for x in axis)})" for axis in ijk_to_ras[:3, :3].T)
    lines = [
        "NRRD0004", f"type: {type_name(kind)}", "dimension: 3", "space: right-anterior-superior",
        f"sizes: {' '.join(map(str, voxels.shape[::-1]))}", f"space directions: {axes}",
        "kinds: domain domain domain", "encoding: gzip",
        f"space origin: ({','.join(f'{x:.9g}' for x in ijk_to_ras[:3, 3])})",
        *(["endian: little"] if kind.itemsize > 1 else []),
    ]  # fmt: skip
    data = gzip.compress(np.ascontiguousarray(voxels, kind.newbyteorder("<")).tobytes(), level, mtime=0)
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
