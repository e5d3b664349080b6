"""``sonospline link``: a simulated scanner and tracker on OpenIGTLink, for 3D Slicer, PLUS and whoever speaks it."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import threading
from pathlib import Path
from typing import Any

from ..simulator.shipped import SHIPPED

HELP = "serve a simulated ultrasound scanner and tracker on OpenIGTLink, without a page"
EXAMPLES = """examples:
  sonospline link                                  # kidney access on port 18944; Ctrl-C ends it
  sonospline link --scene gel --port 0 --json      # a free port, printed as JSON
  sonospline link --tracker localhost:18946        # needle and probe follow a tracker, PLUS or 3D Slicer
  sonospline link --poses sweep.igs.mha            # or a recorded hand
  sonospline link --names mine.toml                # device names and frames a second of your own
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("--scene", default="kidney", metavar="NAME|FILE", help=f"{', '.join(SHIPPED)}, or a scene file")
    parser.add_argument("--model", metavar="NAME", help="which model of tissue answers (as the scene says)")
    parser.add_argument("--port", type=int, default=18944, help="port (18944; 0 for any free one)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (127.0.0.1: this machine alone)")
    parser.add_argument("--names", type=Path, metavar="FILE", help="device names and rate, a TOML file")
    parser.add_argument("--tracker", metavar="HOST:PORT", help="a server of OpenIGTLink whose poses drive it")
    parser.add_argument("--poses", type=Path, metavar="FILE", help="a tracked recording (.igs.mha) that drives it")
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", help="where clients may record (.igs.mha)")
    parser.add_argument("--json", action="store_true", help="print the port as JSON once it is ready")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Serve until Ctrl-C; return what was served."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from .. import _terminal
    from ..io.pose_sequence import read_pose_sequence
    from ..link.scanner import Scanner
    from ..link.scanner_names import ScannerNames
    from ..simulator.session import Session
    from . import _limits

    _limits.check(args, {"port": _limits.Whole(0, 65_535)})
    names = ScannerNames() if args.names is None else ScannerNames.read(args.names)
    if args.tracker is not None:
        names = names.with_tracker(args.tracker)
    if args.recordings is not None and not args.recordings.is_dir():
        raise ValueError(f"--recordings = {str(args.recordings)!r} is no folder; give one that is there")
    sequence = None if args.poses is None else read_pose_sequence(args.poses)
    session = Session(args.scene, model=args.model)
    with Scanner(session, port=args.port, host=args.host, names=names, recordings=args.recordings) as scanner:
        if sequence is not None:
            scanner.station.play(sequence, args.poses.name)
        port = scanner.server.port
        if args.json:
            _terminal.answer(json.dumps({"port": port}))
        else:
            _terminal.say(f"Sonospline sends {names.Image} and answers on port {port} of {args.host} (Ctrl-C ends it)")
        with contextlib.suppress(KeyboardInterrupt):  # the way to end it
            threading.Event().wait()
    return {"port": port, "frames": scanner.frames}


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return what to say at the end."""
    return f"ended; {report['frames']} frames went out on port {report['port']}"
