"""``sonospline serve``: the live simulator in a browser."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import json
import os
import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..simulator.shipped import SHIPPED

if TYPE_CHECKING:
    from ..link.page_link import PageLink

MOST_STATIONS = 64
HELP = "serve the live simulator: a needle and a probe in a browser, tissue that answers"
EXAMPLES = """examples:
  sonospline serve                                        # kidney access; open the address it prints
  sonospline serve --scene gel --port 9000
  sonospline serve --scene mine.toml
  sonospline serve --labels organs.nii.gz --names organs.csv --entry-face y+
  sonospline serve --volume us.mha
  sonospline serve --link 18944                           # 3D Slicer sees what the page shows
  sonospline serve --exercises course --record attempts   # exercises of your own, and every attempt kept
  sonospline serve --lab 8 --results course.db            # a lab of eight stations, and a trainer's page
  sonospline serve --host 0.0.0.0 --token "open sesame"   # for others on the network; Ctrl-C ends it
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    what = parser.add_argument_group("scene (by default access to the kidney)")
    what.add_argument("--scene", metavar="NAME|FILE", help=f"{', '.join(SHIPPED)}, or a scene file (.toml)")
    what.add_argument("--labels", type=Path, metavar="FILE", help="a label map of your own")
    what.add_argument("--names", type=Path, metavar="CSV", help="names of its labels (beside it, .csv)")
    what.add_argument("--ct", type=Path, metavar="FILE", help="CT of the same patient, in which the skin is found")
    what.add_argument("--volume", type=Path, metavar="FILE", help="a real 3-D image of your own, to be cut")
    what.add_argument("--entry-face", metavar="FACE", help="its free face, lattice axis and side; the best one")
    train = parser.add_argument_group("training")
    train.add_argument("--exercises", type=Path, metavar="DIR", help="a folder of exercises of your own (.toml)")
    train.add_argument("--record", type=Path, metavar="DIR", help="a folder to keep the recording of each attempt in")
    lab = parser.add_argument_group("lab")
    lab.add_argument("--lab", type=int, nargs="?", const=8, metavar="N", help="a lab of N stations and a trainer (8)")
    lab.add_argument("--results", metavar="FILE|ADDRESS", help="its results: a file of SQLite, or PostgreSQL (lab.db)")
    lab.add_argument("--course", metavar="NAME", help="what its attempts belong to (today's date)")
    where = parser.add_argument_group("server")
    where.add_argument("--port", type=int, default=8765, help="port (8765; 0 for any free one)")
    where.add_argument("--host", default="127.0.0.1", help="address to listen on (127.0.0.1: this machine alone)")
    where.add_argument("--token", metavar="TEXT", help="what pages have to know; needed with another --host")
    where.add_argument("--sessions", type=int, default=8, metavar="N", help="sessions at once, at most (8)")
    where.add_argument(
        "--idle", type=float, default=30.0, metavar="MIN", help="minutes until an idle session ends (30)"
    )
    link = parser.add_argument_group("OpenIGTLink")
    link.add_argument(
        "--link", type=int, metavar="PORT", help="send what the first page shows, as sonospline link does"
    )
    link.add_argument("--link-names", type=Path, metavar="FILE", help="device names and rates of it, a TOML file")
    parser.add_argument("--json", action="store_true", help="print the address as JSON once it is ready")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Serve until Ctrl-C; return what was served."""
    # Before NumPy is loaded: the threads of its BLAS spin on the processors that draw the picture.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from . import _limits

    _limits.check(
        args,
        {
            "port": _limits.Whole(0, 65_535),
            "link": _limits.Whole(0, 65_535),
            "sessions": _limits.Whole(1, 1000),
            "lab": _limits.Whole(1, MOST_STATIONS),
            "idle": _limits.Real(1e-3, 1e6),
        },
    )
    with _link(args) as link:
        return _serve(args, link)


def _serve(args: argparse.Namespace, link: PageLink | None) -> dict[str, Any]:
    from .. import _terminal

    server = _server(args, link)
    trainer = getattr(server, "trainer_address", None)

    def ready(address: str) -> None:
        if args.json:
            known = {"address": address, "link": None if link is None else link.server.port, "trainer": trainer}
            _terminal.answer(json.dumps({name: value for name, value in known.items() if value is not None}))
            return
        _terminal.say(f"Sonospline is at {address} (Ctrl-C ends it)")
        if trainer is not None:
            _terminal.say(f"{args.lab} stations take that address; the trainer's own is {trainer}")
        if link is not None:
            _terminal.say(f"what the first page shows is on port {link.server.port} of {link.server.host} as well")

    code: Any = 1
    try:
        with contextlib.suppress(KeyboardInterrupt):  # the way to end it
            server.run(ready)
        code = 0
    except SystemExit as end:  # another: SIGTERM
        code = end.code
        raise
    finally:
        if trainer is not None:
            server.course.close()
        if not server.catalog.close(within_s=0.0):
            atexit.register(_leave, code)
    return {"address": server.address, "scene": server.catalog.first}


def _server(args: argparse.Namespace, link: PageLink | None) -> Any:
    options = {
        "host": args.host, "port": args.port, "token": args.token, "idle_s": 60 * args.idle,
        "watch": None if link is None else link.watch,
    }  # fmt: skip
    if args.lab is None:
        from ..server.server import Server

        for name in ("results", "course"):
            if getattr(args, name) is not None:
                raise ValueError(f"--{name} belongs to --lab; give both")
        return Server(_catalog(args), sessions=args.sessions, **options)
    from ..course.course import Course
    from ..course.lab_server import LabServer
    from ..lab.result_store import ResultStore

    catalog = _catalog(args)
    name = args.course or datetime.now().astimezone().date().isoformat()
    with contextlib.ExitStack() as failed:
        store = failed.enter_context(ResultStore(args.results or "lab.db"))
        course = Course(catalog, store, stations=args.lab, name=name, keeps_recordings=args.record is not None)
        failed.callback(course.close)
        server = LabServer(course, **options)
        failed.pop_all()
    return server


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return what to say at the end."""
    return f"ended; {report['scene']} was at {report['address']}"


def _link(args: argparse.Namespace) -> contextlib.AbstractContextManager[PageLink | None]:
    """The link beside the page, where one is asked for: to this machine alone."""
    if args.link is None:
        if args.link_names is not None:
            raise ValueError("--link-names belongs to --link; give the port of the link")
        return contextlib.nullcontext()
    from ..link.page_link import PageLink
    from ..link.scanner_names import ScannerNames

    names = None if args.link_names is None else ScannerNames.read(args.link_names)
    return PageLink(port=args.link, names=names)


def _leave(code: int) -> None:
    """End the process at once: nobody can stop the making of a scene, and its reader may outlive Python badly."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _catalog(args: argparse.Namespace) -> Any:
    from .. import simulator
    from ..server.scene_catalog import Entry, SceneCatalog

    exercises = _exercises(args)
    given = [name for name in ("scene", "labels", "volume") if getattr(args, name) is not None]
    if len(given) > 1:
        raise ValueError(f"--{given[0]} and --{given[1]} were both given; give the one to show")
    for name in ("names", "ct", "entry_face"):
        if (
            getattr(args, name) is not None
            and "labels" not in given
            and (name != "entry_face" or "volume" not in given)
        ):
            raise ValueError(f"--{name.replace('_', '-')} belongs to --labels or --volume; a scene file says it itself")
    if args.labels is not None or args.volume is not None:
        path = args.labels or args.volume
        return SceneCatalog({"own": Entry(_own(args, path), path.parent)}, exercises=exercises)
    if args.scene is None or args.scene in SHIPPED:
        return SceneCatalog(first=args.scene or SHIPPED[0], exercises=exercises)
    path = Path(args.scene)
    if path.suffix != ".toml":
        raise ValueError(f"--scene = {args.scene!r} is not known; give {', '.join(SHIPPED)}, or a .toml file")
    own = {path.stem: Entry(simulator.SceneFile.read(path), path.parent)}
    return SceneCatalog(own, first=path.stem, exercises=exercises)


def _exercises(args: argparse.Namespace) -> Any:
    """Those of a folder before the shipped ones, and where attempts are written down."""
    from ..server.exercise_catalog import ExerciseCatalog, read_folder
    from ..training.attempt_recording import Recordings

    if args.record is not None:
        from .._extras import require

        require("mcap")
    own = None if args.exercises is None else read_folder(args.exercises)
    return ExerciseCatalog(own, recordings=Recordings(args.record))


def _own(args: argparse.Namespace, path: Path) -> Any:
    """The scene of a bare label map or image."""
    from ..geometry.grid import FACES
    from ..io.dicom_slices import is_dicom
    from ..io.files import regular_file
    from ..server.own_scene import own_scene

    if not is_dicom(path):
        regular_file(path, "--labels" if args.labels else "--volume", "the path of an image file")
    if args.entry_face is not None and args.entry_face not in FACES:
        raise ValueError(f"--entry-face = {args.entry_face!r} is none; give one of {', '.join(FACES)}")
    scene = own_scene(path, labelled=args.labels is not None, names=args.names, ct=args.ct, face=args.entry_face)
    sys.stderr.write(f"{path.name}: {scene.description}\n")
    return scene
