"""``sonospline slicer-scene``: a scene of 3D Slicer that is ready for ``sonospline link``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..simulator.shipped import SHIPPED

HELP = "write a scene of 3D Slicer, and a device set of PLUS, for what sonospline link sends"
EXAMPLES = """examples:
  sonospline slicer-scene --out out                              # out/sonospline.mrb, for sonospline link
  sonospline slicer-scene --scene gel --watch vessel --out out   # with SlicerIGT's Breach Warning
  sonospline slicer-scene --drive 18946 --out out                # with transforms to move by hand, for
                                                                 # sonospline link --tracker localhost:18946
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("--scene", default="kidney", metavar="NAME|FILE", help=f"{', '.join(SHIPPED)}, or a scene file")
    parser.add_argument("--names", type=Path, metavar="FILE", help="device names and rate, as of sonospline link")
    parser.add_argument("--host", default="localhost", help="where sonospline link runs (localhost)")
    parser.add_argument("--port", type=int, default=18944, help="its port (18944)")
    parser.add_argument(
        "--drive", type=int, metavar="PORT", help="have 3D Slicer send probe, needle and reference there"
    )
    parser.add_argument("--watch", metavar="MODEL", help="a model that SlicerIGT's Breach Warning guards")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="folder for the results; made if need be"
    )
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the bundle; return its summary."""
    from ..io.staging import staged_folder
    from ..io.writing import write_text
    from ..link.device_set import FILE, device_set_of
    from ..link.scanner_names import ScannerNames
    from ..link.slicer_scene import slicer_scene
    from ..simulator.session import Session
    from . import _limits

    ports = _limits.Whole(1, 65_535)
    _limits.check(args, {"port": ports, "drive": ports})
    names = None if args.names is None else ScannerNames.read(args.names)
    session = Session(args.scene)
    scene = slicer_scene(session, names, host=args.host, port=args.port, drive=args.drive, watch=args.watch)
    with staged_folder(args.out) as folder:
        scene.write(folder / "sonospline.mrb")
        write_text(folder / FILE, device_set_of(names or ScannerNames(), args.host, args.port))
    return {
        "scene": session.scene.spec.name,
        "files": ["sonospline.mrb", FILE],
        "nodes": scene.nodes,
        "port": args.port,
    }


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return where the bundle is."""
    return (
        f"scene         {report['scene']}, {report['nodes']} nodes\n"
        f"open          {args.out / 'sonospline.mrb'} in 3D Slicer with SlicerOpenIGTLink and SlicerIGT, and run\n"
        f"              sonospline link --scene {args.scene} --port {report['port']}"
    )
