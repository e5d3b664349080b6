"""What ``sonospline image`` looks at: a cut of a real volume, or a phantom under a probe."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.plane import ImagePlane
from ..geometry.pose import facing
from ..io.labels import warn_of_labels
from ..io.volumes import read_volume
from ..phantoms.kidney import kidney_phantom
from ..phantoms.phantom_file import read_phantom
from ..phantoms.wide_kidney import wide_kidney_phantom
from ..ultrasound.artefacts import Artefacts
from ..ultrasound.display import Display
from ..ultrasound.doppler import Doppler
from ..ultrasound.frame import Frame
from ..ultrasound.needle_echo import LOOKS
from ..ultrasound.phantom import Phantom
from ..ultrasound.probe import PROBES
from ..ultrasound.reslice import Reslicer, swept
from ..ultrasound.synthesis import Scanner
from . import _points

Array = NDArray[np.float64]

_NOISE_DB = -70.0
_FRAME_S = 0.05
"""Between frames of a cine: blood flows on."""


class View(NamedTuple):
    """How to see the tissue, the grid of it that moves, and the needle, where there is one."""

    render: Callable[[GridField | None, Needle | None, int], Frame]
    grid: Grid
    needle: Needle | None


def view_of(args: argparse.Namespace) -> View:
    """Return what the options ask for."""
    return _cut(args) if args.volume is not None else _scanned(args)


def _cut(args: argparse.Namespace) -> View:
    """A real volume, cut through the needle or the origin."""
    volume = read_volume(args.volume)
    warn_of_labels(volume, args.volume, "whose numbers are cut as grey levels; --labels shows it as tissue")
    needle = _given_needle(args)
    if needle is None and args.origin is None:
        raise ValueError("--origin is missing; give a point of the cut, or a needle with --entry and --target")
    through = _points.parse("origin", args.origin) if needle is None or args.origin else needle.tip
    right = needle.direction if needle is not None and args.right is None else _direction(args, "right", "1,0,0")
    down = None if args.look is None else _points.parse("look", args.look)
    plane = ImagePlane.along(volume.lattice, right, through=through, down=down)
    reslicer = Reslicer(volume, seen=swept(volume))
    return View(lambda field, _needle, _frame: reslicer.cut(plane, field), volume.grid(args.nodes), needle)


def _scanned(args: argparse.Namespace) -> View:
    """A phantom under a probe."""
    settings = {"frequency_mhz": args.frequency, "depth_mm": args.depth}
    probe = PROBES[args.probe](**{name: value for name, value in settings.items() if value is not None})
    needle = _given_needle(args)
    if args.labels is None:
        paint = wide_kidney_phantom if args.wide else kidney_phantom
        kidney = paint(spacing_mm=args.voxel, pressed=args.probe == "curvilinear" and args.origin is None)
        phantom, grid, pose = kidney.phantom, kidney.grid(args.nodes), kidney.probe_to_reference
        needle = kidney.needle if needle is None else needle
    else:
        if (args.table is None) == (args.names is None):
            raise ValueError("--labels needs --table (acoustic properties) or --names (organ names), one of them")
        phantom = read_phantom(args.labels, table=args.table, names=args.names, ct=args.ct)
        grid = phantom.labels.grid(args.nodes)
        if args.origin is None:
            raise ValueError("--origin is missing; give the middle of the probe's face, X,Y,Z (RAS mm)")
    if args.origin is not None:
        look, right = _direction(args, "look", "0,0,1"), _direction(args, "right", "1,0,0")
        pose = facing(_points.parse("origin", args.origin), depth=look, right=right)
    phantom = phantom.textured() if args.textures else phantom
    noise = Display().noise_db if args.clean else _NOISE_DB
    display = Display(gain_db=Display().gain_db + args.gain, range_db=args.dynamic_range, noise_db=noise)
    scanner = Scanner(
        phantom, probe, pose, display=display, needle_echo=LOOKS[args.needle](), seed=args.seed,
        artefacts=Artefacts.none() if args.clean else Artefacts(), doppler=_doppler(args, phantom),
    )  # fmt: skip
    return View(
        lambda field, at, frame: scanner.render(field, at, frame=frame, time_s=_FRAME_S * frame).frame, grid, needle
    )


def _doppler(args: argparse.Namespace, phantom: Phantom) -> Doppler | None:
    """Colour Doppler, where it is asked for."""
    if args.doppler is None:
        return None
    if not phantom.flows:
        raise ValueError("--doppler shows blood that flows, and these labels have none; leave it out")
    box = args.doppler.split(",")
    try:
        left, right, top, bottom = map(float, box)
    except ValueError:
        raise ValueError(f"--doppler = {args.doppler!r} is no box; give left,right,top,bottom in mm") from None
    asked = {"prf_hz": args.prf, "steer_deg": args.steer}
    return Doppler(box_mm=(left, right, top, bottom), **{name: x for name, x in asked.items() if x is not None})


def _direction(args: argparse.Namespace, name: str, default: str) -> Array:
    return _points.parse(name, getattr(args, name) or default)


def _given_needle(args: argparse.Namespace) -> Needle | None:
    if args.entry is None and args.target is None:
        return None
    for name in ("entry", "target"):
        if getattr(args, name) is None:
            raise ValueError(f"--{name} is missing; give X,Y,Z (RAS mm), or neither of --entry and --target")
    return Needle(_points.parse("entry", args.entry), _points.parse("target", args.target))
