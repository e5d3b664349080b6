"""Reports about data sets as lines for a person."""

from __future__ import annotations

from typing import Any

_MOST = 5
"""Reasons, problems, that are listed."""


def lines_of(report: dict[str, Any], action: str) -> str:
    """Return the report of an action as lines."""
    shown = {
        "make": _made, "rebuild": _made, "show": _shown, "check": _checked, "stats": _stats, "episodes": _episodes
    }[action](report)  # fmt: skip
    return "\n".join(shown)


def _episodes(report: dict[str, Any]) -> list[str]:
    return [
        f"episodes      {report['episodes']:,} in {report['out']}, {report['solved']:,} of them solved",
        f"size          {report['frames']:,} frames, {report['bytes'] / 1e6:,.1f} MB; the video is lossy",
    ]


def _made(report: dict[str, Any]) -> list[str]:
    there = report["samples"] - report["made"]
    lines = [
        f"samples       {report['samples']:,} in {report['out']}, {report['made']:,} of them made now"
        + (f", {there:,} were there" if there else ""),
        f"size          {report['bytes_a_sample']:,.0f} bytes a sample",
        f"hash          {report['hash']}",
    ]
    return lines + _failed(report["failed"])


def _failed(failed: dict[str, str]) -> list[str]:
    lines = [f"failed        {len(failed):,}"] if failed else []
    lines += [f"  {index}: {reason}" for index, reason in list(failed.items())[:_MOST]]
    return lines + ([f"  and {len(failed) - _MOST:,} more, in manifest.json"] if len(failed) > _MOST else [])


def _shown(report: dict[str, Any]) -> list[str]:
    splits = ", ".join(f"{count:,} {name}" for name, count in sorted(report["splits"].items()))
    lines = [
        f"{report['name']}: {report['samples']:,} samples ({splits}), {report['bytes_a_sample']:,.0f} bytes each, "
        f"licence {report['licence']}"
    ]
    lines += [f"  {report['description']}"] if report["description"] else []
    lines += [
        f"  {name:13} {' x '.join(map(str, form['shape'])):>14} {form['dtype']:8} {form['about']}"
        for name, form in report["arrays"].items()
    ]
    labels = ", ".join(f"{number} {name}" for name, number in report["labels"].items())
    made = report["made_by"]
    lines += [f"labels        {labels}", f"made by       sonospline {made['sonospline']}, {made['instruction_set']}"]
    return [*lines, f"hash          {report['hash']}", *_failed(report["failed"])]


def _checked(report: dict[str, Any]) -> list[str]:
    lines = [f"{report['files']:,} files are as the manifest says" if not report["problems"] else "problems"]
    lines += [f"  {problem}" for problem in report["problems"][:_MOST]]
    lines += [f"{report['remade']:,} samples made again, bit for bit"] if report["remade"] else []
    if report.get("forgotten"):
        lines.append(f"forgotten     shards {', '.join(map(str, report['forgotten']))}; make makes them again")
    return lines


def _stats(report: dict[str, Any]) -> list[str]:
    lines = [f"{report['samples']:,} samples, {report['failed']:,} failed"]
    for title in ("splits", "targets", "events"):
        if report[title]:
            lines.append(f"{title:13} {', '.join(f'{count:,} {name}' for name, count in report[title].items())}")
    lines.append(f"{'':18}" + "".join(f"{name:>10}" for name in ("least", "q05", "median", "q95", "largest")))
    for name, spread in report["numbers"].items():
        cells = (spread[key] for key in ("least", "q05", "median", "q95", "largest"))
        lines.append(f"{name:18}" + "".join(f"{value:10.4g}" for value in cells))
    return lines
