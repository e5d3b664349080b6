"""``sonospline replay``: make a recorded session's frames again, check them pixel by pixel, and measure the attempt."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ..io.staging import staged_folder
from ..simulator.scene_file import SceneFile
from ..simulator.scene_maker import make_scene
from ..simulator.shipped import SHIPPED
from ..training.comments import read_comments
from ..training.metric import METRICS, measure
from ..training.recording import Recording
from ..training.replay import replay, unlike
from ..training.replay_player import Replayed
from ..ultrasound.cine import write_gif, write_sequence
from ._progress import track

HELP = "replay a recorded session: every frame again, bit for bit, and its metrics"
EXAMPLES = """examples:
  sonospline replay attempt.mcap                       # are all frames the recorded ones? and the metrics
  sonospline replay attempt.mcap --out out             # also metrics.json, cine.igs.mha (3D Slicer) and cine.gif
  sonospline replay attempt.mcap --no-frames --json    # the metrics alone, at once
  sonospline replay attempt.mcap --scene mine.toml     # recorded in a scene of your own
"""
_MOST_SHOWN = 20_000
"""Frames of a cine: they are held until they are written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("recording", type=Path, metavar="FILE", help="an .mcap file of a session")
    parser.add_argument("--scene", metavar="NAME|FILE", help="its scene (by default the shipped one of its name)")
    parser.add_argument("--no-frames", action="store_true", help="make no frame again; the metrics alone")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write: metrics, and the frames as a cine")
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout")
    parser.add_argument("--quiet", action="store_true", help="say nothing meanwhile")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its report."""
    if args.no_frames and args.scene:
        raise ValueError("--scene and --no-frames were both given; without frames no scene is needed")
    recording, comments = Recording.read(args.recording), read_comments(args.recording)
    report: dict[str, Any] = {
        "recording": args.recording.name, "scene": recording.header["scene"], "steps": len(recording.steps),
        "seconds": recording.seconds, "whole": recording.whole, "version": recording.header["version"],
        "metrics": _metrics(recording),
        "comments": [{"time_s": one.time_s, "text": one.text} for one in comments],
    }  # fmt: skip
    cine: list[Any] = []
    if not args.no_frames:
        frames = replay(recording, make_scene(_scene(recording, args.scene)))
        report |= _checked(frames, recording, cine if args.out else None, args)
    if args.out:
        with staged_folder(args.out) as folder:
            (folder / "metrics.json").write_text(json.dumps(report["metrics"], indent=2) + "\n")
            if cine:
                frame_ms = 1000 * recording.seconds / max(len(cine) - 1, 1)
                write_sequence(cine, folder / "cine.igs.mha", frame_ms=frame_ms)
                write_gif(cine, folder / "cine.gif", frame_ms=max(frame_ms, 20.0))
        report["files"] = ["metrics.json", *(["cine.igs.mha", "cine.gif"] if cine else [])]
    return report


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the report as a few lines for a person."""
    cut = "" if report["whole"] else ", cut off: what came in its last half second is not in it"
    lines = [f"recording     {report['steps']:,} steps in {report['seconds']:.1f} s of {report['scene']}{cut}"]
    if "same" in report:
        all_same = "every pixel is the recorded one" if report["same"] == report["steps"] else (
            f"frame {report['first_different']} is the first of {report['steps'] - report['same']:,} that differ"
        )  # fmt: skip
        lines += [f"frames        {all_same}{'; ' + report['unlike'] if report['unlike'] else ''}"]
    for name, value in report["metrics"].items():
        if value is not None:
            lines.append(f"  {name:34} {value:10.4g} {METRICS[name].unit}")
    lines += [f"comment       {one['time_s']:.1f} s: {one['text']}" for one in report["comments"]]
    if "files" in report:
        lines.append(f"files         {', '.join(report['files'])} in {args.out}")
    return "\n".join(lines)


def _metrics(recording: Recording) -> dict[str, float | None]:
    if len({step.time_s for step in recording.attempt}) < 2:
        return {}
    return {name: None if value != value else value for name, value in measure(recording.trace()).items()}


def _scene(recording: Recording, asked: str | None) -> SceneFile | str | Path:
    if asked:
        return asked if asked in SHIPPED else Path(asked)
    found = next((name for name in SHIPPED if SceneFile.shipped(name).name == recording.header["scene"]), None)
    if found is None:
        raise ValueError(
            f"the recording's scene, {recording.header['scene']!r}, is not a shipped one; give --scene FILE"
        )
    return found


def _checked(frames: Any, recording: Recording, cine: list[Any] | None, args: argparse.Namespace) -> dict[str, Any]:
    """Make the frames again; those of one shape with the last are kept where a cine is asked for."""
    if cine is not None and len(recording.steps) > _MOST_SHOWN:
        raise ValueError(f"--out: {len(recording.steps):,} frames are too many for a cine; give --no-frames")
    same, first = 0, None
    found: Replayed
    for found in track(frames, len(recording.steps), "replaying", quiet=args.quiet):
        same += found.same
        if not found.same and first is None:
            first = found.step.number
        if cine is not None:
            if cine and cine[-1].pixels.shape != found.frame.image.pixels.shape:
                cine.clear()
            cine.append(found.frame.image)
    other = unlike(recording)
    if same < len(recording.steps) and not other:
        raise RuntimeError(f"frame {first} is not the recorded one, on the same backend; was another version at work?")
    return {"same": same, "first_different": first, "unlike": other}
