"""``sonospline image``: the ultrasound image of a phantom or a volume, before and after a needle."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._extras import require
from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.plane import ImagePlane
from ..geometry.pose import facing
from ..geometry.tissue import Tissue
from ..io.labels import labels_named, read_labels, warn_of_labels
from ..io.staging import staged_folder
from ..io.tables import read_names
from ..io.volumes import read_volume
from ..io.writing import write_json
from ..models.spline.insertion import Insertion
from ..models.spline.interaction import NeedleTissueModel
from ..ultrasound.acoustics import read_table
from ..ultrasound.cine import write_gif, write_sequence
from ..ultrasound.frame import Frame
from ..ultrasound.kidney import kidney_phantom
from ..ultrasound.needle_echo import LOOKS
from ..ultrasound.organs import LARGEST_ORGAN, phantom_from_organs
from ..ultrasound.phantom import LARGEST_LABEL, Phantom
from ..ultrasound.probe import PROBES
from ..ultrasound.reslice import Reslicer, swept
from ..ultrasound.synthesis import Display, Scanner
from . import _folds, _limits, _points
from ._progress import track

Array = NDArray[np.float64]
_TIMED_FRAMES = 5
_LIMITS: _limits.Limits = {
    "seed": _limits.SEED,
    "nodes": _limits.NODES,
    "cine": _limits.Whole(0, 10_000, bytes_each=2_000_000),
    "frequency": _limits.Real(0.1, 100),
    "depth": _limits.Real(1, 1000),
    "gain": _limits.Real(-200, 200),
    "dynamic_range": _limits.Real(1, 300),
}

View = Callable[[GridField | None, Needle | None, int], Frame]

HELP = "render the ultrasound image of a phantom, or cut a real volume, before and after a needle"
EXAMPLES = """examples:
  sonospline image --out out                                        # the kidney phantom, needle in a calyx
  sonospline image --probe linear --depth 50 --origin 110,50,0.3 --out out
  sonospline image --labels seg.nrrd --table tissues.csv --origin 0,0,0 --look 0,0,1 --right 1,0,0 --out out
  sonospline image --labels organs.nii.gz --names organs.csv --ct ct.nii.gz --origin 67,20,118 --look 0,1,0 --out out
  sonospline image --volume us.mha --entry 10,20,30 --target 40,20,30 --cine 20 --out out
"""


@dataclass(frozen=True)
class Sight:
    """What is looked at: how to see it, the tissue that moves, and the needle, where there is one."""

    view: View
    grid: Grid
    needle: Needle | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    what = parser.add_argument_group("what is imaged (by default the generated kidney phantom)")
    what.add_argument("--volume", type=Path, metavar="FILE", help="a real 3-D image, to be cut along a plane")
    what.add_argument("--labels", type=Path, metavar="FILE", help="a label map, to be rendered")
    what.add_argument("--table", type=Path, metavar="CSV", help="acoustic properties of its labels")
    what.add_argument("--names", type=Path, metavar="CSV", help="organ names of its labels, instead of a table")
    what.add_argument("--voxel", type=float, default=0.5, metavar="MM", help="voxel of the generated phantom (0.5)")
    what.add_argument("--ct", type=Path, metavar="FILE", help="CT of the same patient, for voxels without a label")
    where = parser.add_argument_group("from where (RAS mm)")
    where.add_argument("--origin", metavar="X,Y,Z", help="middle of the probe's face, or a point of the cut")
    where.add_argument(
        "--look", metavar="X,Y,Z", help="direction away from the probe, downwards in the picture (0,0,1)"
    )
    where.add_argument("--right", metavar="X,Y,Z", help="direction to the right in the picture (1,0,0)")
    probe = parser.add_argument_group("probe and display")
    probe.add_argument("--probe", default="curvilinear", choices=tuple(PROBES), help="kind of probe (curvilinear)")
    probe.add_argument("--frequency", type=float, metavar="MHZ", help="centre frequency")
    probe.add_argument("--depth", type=float, metavar="MM", help="depth of the image")
    probe.add_argument("--gain", type=float, default=0.0, metavar="DB", help="added gain (0)")
    probe.add_argument("--dynamic-range", type=float, default=60.0, metavar="DB", help="black to white (60)")
    needle = parser.add_argument_group("needle")
    needle.add_argument("--entry", metavar="X,Y,Z", help="where it enters the tissue")
    needle.add_argument("--target", metavar="X,Y,Z", help="where its tip ends")
    needle.add_argument("--needle", default="trocar", choices=tuple(LOOKS), help="how it looks (trocar)")
    _folds.add_argument(needle)
    needle.add_argument("--nodes", type=int, default=150_000, metavar="N", help="grid nodes, about (150000)")
    out = parser.add_argument_group("what comes out")
    out.add_argument("--cine", type=int, default=0, metavar="N", help="also N frames of the insertion (.igs.mha, .gif)")
    out.add_argument("--seed", type=int, default=0, help="seed of scatterers and noise (0)")
    out.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    out.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")
    out.add_argument("--quiet", action="store_true", help="no progress bar")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    _limits.check(args, _LIMITS)
    _points.check(args, "entry", "target", "origin", "look", "right")
    if args.volume is not None and args.labels is not None:
        raise ValueError("--volume and --labels were both given; give the one to image")
    for name, needed in (("table", "labels"), ("names", "labels"), ("ct", "names")):
        if getattr(args, name) is not None and getattr(args, needed) is None:
            raise ValueError(f"--{name} belongs to --{needed}; give both or neither")
    sight = _volume(args) if args.volume is not None else _rendered(args)
    if args.cine:
        require("PIL.Image")  # said now, not after the frames
    if args.cine and sight.needle is None:
        raise ValueError("--cine needs a needle; give --entry and --target")
    with staged_folder(args.out) as folder:
        return _write(sight, folder, args)


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the summary as a few lines for a person."""
    rows, columns = summary["picture"]
    lines = [f"picture       {columns} x {rows} pixels of {summary['pixel_mm']:.3f} mm"]
    if summary["max_displacement_mm"] is not None:
        lines.append(f"displacement  {summary['max_displacement_mm']:.2f} mm at most")
    kind = f"{summary['backend']}, {summary['instruction_set']}"
    lines.append(f"frame         {summary['render_ms']:.1f} ms ({kind}); {summary['first_ms']:.0f} ms with set-up")
    return "\n".join([*lines, f"files         {', '.join(summary['files'])} in {args.out}"])


def _direction(args: argparse.Namespace, name: str, default: str) -> Array:
    return _points.parse(name, getattr(args, name) or default)


def _given_needle(args: argparse.Namespace) -> Needle | None:
    if args.entry is None and args.target is None:
        return None
    for name in ("entry", "target"):
        if getattr(args, name) is None:
            raise ValueError(f"--{name} is missing; give X,Y,Z (RAS mm), or neither of --entry and --target")
    return Needle(_points.parse("entry", args.entry), _points.parse("target", args.target))


def _volume(args: argparse.Namespace) -> Sight:
    """A real volume, cut through the needle or the origin."""
    volume = read_volume(args.volume)
    warn_of_labels(volume, args.volume, "whose numbers are cut as grey levels; --labels shows it as tissue")
    needle = _given_needle(args)
    if needle is None and args.origin is None:
        raise ValueError("--origin is missing; give a point of the cut, or a needle with --entry and --target")
    through = _points.parse("origin", args.origin) if needle is None or args.origin else needle.tip
    right = needle.direction if needle is not None and args.right is None else _direction(args, "right", "1,0,0")
    down = np.eye(3)[int(np.argmin(np.abs(right)))] if args.look is None else _direction(args, "look", "0,0,1")
    plane = ImagePlane.crossing(volume.lattice, normal=np.cross(right, down), through=through, right=right)
    reslicer = Reslicer(volume, seen=swept(volume))
    return Sight(lambda field, _needle, _frame: reslicer.cut(plane, field), volume.grid(args.nodes), needle)


def _rendered(args: argparse.Namespace) -> Sight:
    """A phantom under a probe."""
    settings = {"frequency_mhz": args.frequency, "depth_mm": args.depth}
    probe = PROBES[args.probe](**{name: value for name, value in settings.items() if value is not None})
    needle = _given_needle(args)
    if args.labels is None:
        kidney = kidney_phantom(spacing_mm=args.voxel, pressed=args.probe == "curvilinear" and args.origin is None)
        phantom, grid, pose = kidney.phantom, kidney.grid(args.nodes), kidney.probe_to_reference
        needle = kidney.needle if needle is None else needle
    else:
        phantom = _scene(args)
        lattice = phantom.labels.lattice
        grid = Grid.covering(lattice.extent, nodes=args.nodes, origin=lattice.origin, direction=lattice.direction)
        if args.origin is None:
            raise ValueError("--origin is missing; give the middle of the probe's face, X,Y,Z (RAS mm)")
    if args.origin is not None:
        look, right = _direction(args, "look", "0,0,1"), _direction(args, "right", "1,0,0")
        pose = facing(_points.parse("origin", args.origin), depth=look, right=right)
    display = Display(gain_db=Display().gain_db + args.gain, range_db=args.dynamic_range)
    scanner = Scanner(phantom, probe, pose, display=display, needle_echo=LOOKS[args.needle](), seed=args.seed)
    return Sight(lambda field, at, frame: scanner.render(field, at, frame=frame).frame, grid, needle)


def _scene(args: argparse.Namespace) -> Phantom:
    if (args.table is None) == (args.names is None):
        raise ValueError("--labels needs --table (acoustic properties) or --names (organ names), one of them")
    if args.table is not None:
        labels, table = read_labels(args.labels, largest=LARGEST_LABEL), read_table(args.table)
        with labels_named(args.labels):
            return Phantom(labels, table)
    labels, names = read_labels(args.labels, largest=LARGEST_ORGAN), read_names(args.names)
    ct = None if args.ct is None else read_volume(args.ct, name="ct")
    with labels_named(args.labels):
        return phantom_from_organs(labels, names, ct=ct)


def _write(sight: Sight, folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    start = time.perf_counter()
    before = sight.view(None, None, 0)
    first_ms = 1e3 * (time.perf_counter() - start)
    before.save(folder / "before.png")
    shown, largest, field = before, None, None
    if sight.needle is not None:
        insertion, needle = _insertion(sight), sight.needle
        frames = []
        for k in track(range(args.cine), args.cine, "imaging", quiet=args.quiet):
            at = Needle(needle.entry, needle.at((k + 1) / args.cine))
            frames.append(sight.view(GridField.of(insertion.advance(at)), at, k))
        final = insertion.advance(needle)
        _folds.refuse(np.linalg.det(final.jacobian(sight.grid.points)).reshape(sight.grid.shape), sight.grid, args)
        field = GridField.of(final)
        largest = float(np.linalg.norm(field.values, axis=-1).max())
        shown = sight.view(field, needle, args.cine)
        shown.save(folder / "after.png")
        if frames:
            write_sequence(frames, folder / "cine.igs.mha")
            write_gif([before, *frames], folder / "cine.gif")
    shown.save(folder / "image.mha")
    summary = {
        "verb": "image",
        "picture": before.pixels.shape,
        "pixel_mm": before.plane.spacing_mm[0],
        "image_to_reference": before.plane.image_to_reference.tolist(),
        "seen_share": None if before.mask is None else float(before.mask.mean()),
        "entry_ras_mm": None if sight.needle is None else sight.needle.entry.tolist(),
        "target_ras_mm": None if sight.needle is None else sight.needle.tip.tolist(),
        "max_displacement_mm": largest,
        "first_ms": first_ms,
        "render_ms": _frame_ms(sight, field),
        "backend": _core.backend(),
        "instruction_set": _core.instruction_set(),
        "seed": args.seed,
    }
    summary["files"] = sorted([*(file.name for file in folder.iterdir()), "summary.json"])
    write_json(folder / "summary.json", summary)
    return summary


def _frame_ms(sight: Sight, field: GridField | None) -> float:
    """Median time of some frames after what was set up for the field's lattice."""
    times = []
    for frame in range(_TIMED_FRAMES + 1):
        start = time.perf_counter()
        sight.view(field, sight.needle, frame)
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times[1:]))


def _insertion(sight: Sight) -> Insertion:
    assert sight.needle is not None
    face = sight.grid.nearest_face(sight.needle.entry)
    return Insertion(Tissue(sight.grid, entry_face=face), NeedleTissueModel.paper(sight.grid.side))
