"""``sonospline image``: the ultrasound image of a phantom or a volume, before and after a needle."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .._extras import require
from ..io.staging import staged_folder
from ..ultrasound.needle_echo import LOOKS
from ..ultrasound.probe import PROBES
from . import _folds, _limits, _options, _points
from ._image_results import write
from ._image_view import view_of

_LIMITS: _limits.Limits = {
    "seed": _limits.SEED,
    "nodes": _limits.NODES,
    "cine": _limits.Whole(0, 10_000, bytes_each=2_000_000),
    "frequency": _limits.Real(0.1, 100),
    "depth": _limits.Real(1, 1000),
    "gain": _limits.Real(-200, 200),
    "dynamic_range": _limits.Real(1, 300),
    "prf": _limits.Real(1, 100_000),
    "steer": _limits.Real(-30, 30),
}

HELP = "render the ultrasound image of a phantom, or cut a real volume, before and after a needle"
EXAMPLES = """examples:
  sonospline image --out out                                        # the kidney phantom, needle in a calyx
  sonospline image --probe linear --depth 50 --origin 110,50,0.3 --out out
  sonospline image --origin 64,44,8 --doppler=-12,14,62,106 --out out   # the renal artery; the = for the minus
  sonospline image --wide --textures --origin 62,58,8 --right 0,1,0 --out out   # across the kidney
  sonospline image --labels seg.nrrd --table tissues.csv --origin 0,0,0 --look 0,0,1 --right 1,0,0 --out out
  sonospline image --labels organs.nii.gz --names organs.csv --ct ct.nii.gz --origin 67,20,118 --look 0,1,0 --out out
  sonospline image --volume us.mha --entry 10,20,30 --target 40,20,30 --cine 20 --out out
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    what = parser.add_argument_group("what is imaged (by default the generated kidney phantom)")
    what.add_argument("--volume", type=Path, metavar="FILE", help="a real 3-D image, to be cut along a plane")
    what.add_argument("--labels", type=Path, metavar="FILE", help="a label map, to be rendered")
    what.add_argument("--table", type=Path, metavar="CSV", help="acoustic properties of its labels")
    what.add_argument("--names", type=Path, metavar="CSV", help="organ names of its labels, instead of a table")
    what.add_argument("--voxel", type=float, default=0.5, metavar="MM", help="voxel of the generated phantom (0.5)")
    what.add_argument("--wide", action="store_true", help="the kidney with ribs, pleura, liver, colon, spine")
    what.add_argument("--textures", action="store_true", help="fibrils, septa, portal triads in its tissues")
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
    probe.add_argument("--clean", action="store_true", help="clean beams: no clutter, haze or rough surfaces")
    colour = parser.add_argument_group("colour Doppler (of phantoms whose blood flows: the generated kidney)")
    colour.add_argument("--doppler", metavar="L,R,T,B", help="its box: left, right, top, bottom, mm from the face")
    colour.add_argument("--prf", type=float, metavar="HZ", help="pulses a second (3000)")
    colour.add_argument("--steer", type=float, metavar="DEG", help="lean of a linear probe's beams to the right (0)")
    needle = parser.add_argument_group("needle")
    _options.add_path(needle)
    needle.add_argument("--needle", default="trocar", choices=tuple(LOOKS), help="how it looks (trocar)")
    _folds.add_argument(needle)
    _options.add_nodes(needle)
    out = parser.add_argument_group("what comes out")
    out.add_argument("--cine", type=int, default=0, metavar="N", help="also N frames of the insertion (.igs.mha, .gif)")
    _options.add_seed(out, "of scatterers and noise")
    _options.add_output(out)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    _limits.check(args, _LIMITS)
    _points.check(args, "entry", "target", "origin", "look", "right")
    if args.volume is not None and args.labels is not None:
        raise ValueError("--volume and --labels were both given; give the one to image")
    if args.wide and (args.volume is not None or args.labels is not None):
        raise ValueError("--wide is of the generated kidney; leave it out, or --volume and --labels")
    for name, needed in (("table", "labels"), ("names", "labels"), ("ct", "names")):
        if getattr(args, name) is not None and getattr(args, needed) is None:
            raise ValueError(f"--{name} belongs to --{needed}; give both or neither")
    if args.doppler is not None and args.volume is not None:
        raise ValueError("--doppler is of a phantom, and --volume is a real image; give one of them")
    if args.doppler is None and (args.prf is not None or args.steer is not None):
        raise ValueError("--prf and --steer belong to --doppler; give its box, L,R,T,B (mm)")
    view = view_of(args)
    if args.cine:
        require("PIL.Image")  # said now, not after the frames
    if args.cine and view.needle is None:
        raise ValueError("--cine needs a needle; give --entry and --target")
    with staged_folder(args.out) as folder:
        return write(view, folder, args)


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the summary as a few lines for a person."""
    rows, columns = summary["picture"]
    lines = [f"picture       {columns} x {rows} pixels of {summary['pixel_mm']:.3f} mm"]
    if summary["max_displacement_mm"] is not None:
        lines.append(f"displacement  {summary['max_displacement_mm']:.2f} mm at most")
    kind = f"{summary['backend']}, {summary['instruction_set']}"
    lines.append(f"frame         {summary['render_ms']:.1f} ms ({kind}); {summary['first_ms']:.0f} ms with set-up")
    return "\n".join([*lines, f"files         {', '.join(summary['files'])} in {args.out}"])
