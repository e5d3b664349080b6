"""``sonospline tune --forces``: what tissues resist, fitted to measured curves of force against depth."""

from __future__ import annotations

import argparse
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..contact.calibration.force_curve import ForceCurve
from ..contact.calibration.force_fit import ForceFit, fit_forces
from ..contact.calibration.least_squares import FASTER, RUPTURE, UNITS, YIELDING
from ..io.canvas import attempt, picture
from ..io.staging import staged_folder
from ..io.writing import write_json, write_text
from ..mechanics.material import Material
from ..mechanics.material_table import MaterialTable


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    curves = [ForceCurve.read(path) for path in args.forces]
    table = MaterialTable.of(args.materials)
    fit = fit_forces(curves)
    source = ", ".join(curve.name for curve in curves)
    with staged_folder(args.out) as folder:
        write_text(folder / "materials.toml", _materials_text(fit.materials(table, source), source))
        if membranes := _membranes_text(fit, curves, source):
            write_text(folder / "membranes.toml", membranes)
        write_text(folder / "forces.csv", _curves_text(fit, curves))
        attempt(lambda: _draw(fit, curves, folder / "forces.png"))
        summary = _summary(fit, curves)
        summary["files"] = sorted([*(file.name for file in folder.iterdir()), "summary.json"])
        write_json(folder / "summary.json", summary)
    return summary


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return what a person wants to see first."""
    lines = [
        f"curves        {', '.join(curve['name'] for curve in summary['curves'])}",
        f"left          {summary['residual_n']:.3f} N in the root mean square, {summary['explained']:.1%} explained",
        "",
        f"{'tissue':20s}{'value':24s}{'fitted':>10s}{'+-':>10s}",
    ]
    for row in summary["values"]:
        error = "unknown" if not row["known"] else f"{row['error']:.2g}"
        lines.append(f"{row['tissue']:20s}{row['of']:24s}{row['value']:10.3g}{error:>10s} {row['unit']}")
    lines += ["", *(f"not known: {line}" for line in summary["untold"])]
    return "\n".join([*lines, "", f"materials     {args.out / 'materials.toml'}"])


def _summary(fit: ForceFit, curves: list[ForceCurve]) -> dict[str, Any]:
    return {
        "verb": "tune",
        "curves": [
            {"name": curve.name, "samples": len(curve.depths_mm), "depth_mm": float(curve.depths_mm[-1]),
             "speed_mm_s": curve.speed_mm_s, "noise_n": curve.noise_n,
             "punctures": [{"tissue": curve.tissues[n][0], "depth_mm": at} for n, at in sorted(dents.items())]}
            for curve, dents in zip(curves, fit.dents, strict=True)
        ],
        "values": [
            {"tissue": tissue, "of": kind, "unit": UNITS[kind], "value": found.value,
             "error": found.error if np.isfinite(found.error) else None, "known": found.known}
            for (kind, tissue), found in fit.values.items() if kind != YIELDING
        ],
        "passed_mm": dict(fit.passed_mm),
        "residual_n": fit.residual_n,
        "explained": fit.explained,
        "untold": list(fit.untold),
    }  # fmt: skip


def _materials_text(materials: dict[str, Material], source: str) -> str:
    """A table for ``--materials``; what is as everywhere is left out."""
    lines = [f"# sonospline tune --forces: friction and cutting force fitted to {source}"]
    for name, material in materials.items():
        lines += ["", f"[{_text(name)}]"]
        for known in fields(Material):
            value = getattr(material, known.name)
            if known.name in ("stiffness_kpa", "source") or value != known.default:
                lines.append(f"{known.name} = {_text(value)}")
    return "\n".join([*lines, ""])


def _membranes_text(fit: ForceFit, curves: list[ForceCurve], source: str) -> str:
    """``[[membranes]]`` of a scene file: each around what the needle passes from there on."""
    lines, written = [f"# sonospline tune --forces: for a scene file; fitted to {source}"], set()
    for curve, dents in zip(curves, fit.dents, strict=True):
        for number in sorted(dents):
            tissue = curve.tissues[number][0]
            force = fit.values[RUPTURE, tissue]
            if tissue in written or not force.known:
                continue
            written.add(tissue)
            around = list(dict.fromkeys(name for name, _ in curve.tissues[number:]))
            faster = fit.values.get((FASTER, tissue))
            lines += ["", "[[membranes]]", f"name = {_text(f'around {tissue}')}", f"around = {_text(around)}"]
            lines.append(f"rupture_force_n = {force.value:.4g}")
            if faster is not None and faster.known:
                lines.append(f"rate = {np.clip(faster.value / force.value, -0.9, 0.9):.3g}")
            lines.append(f"source = {_text(f'fitted to {source}, +- {force.error:.2g} N')}")
    return "\n".join([*lines, ""]) if written else ""


def _curves_text(fit: ForceFit, curves: list[ForceCurve]) -> str:
    rows = ["curve,depth_mm,force_n,modelled_n"]
    for curve, modelled in zip(curves, fit.modelled_n, strict=True):
        rows += [
            f"{curve.name},{depth:g},{force:.5g},{fitted:.5g}"
            for depth, force, fitted in zip(curve.depths_mm, curve.force_n, modelled, strict=True)
        ]
    return "\n".join([*rows, ""])


def _text(value: Any) -> str:
    """A value as TOML has it, which for texts, numbers, flags and lists is as JSON has it."""
    return json.dumps(value, ensure_ascii=False)


def _draw(fit: ForceFit, curves: list[ForceCurve], path: Path) -> None:
    """The measured and the fitted force of each curve, and where its tissues begin."""
    with picture(path, 7, 3 * len(curves) + 0.5) as figure:
        panels = figure.subplots(len(curves), 1, squeeze=False)[:, 0]
        for panel, curve, modelled in zip(panels, curves, fit.modelled_n, strict=True):
            panel.plot(curve.depths_mm, curve.force_n, ".", ms=3, color="#9aa5ad", label="measured")
            panel.plot(curve.depths_mm, modelled, "-", color="#ff5a36", label="fitted")
            for tissue, begin in curve.tissues:
                panel.axvline(begin, lw=0.8, ls=":", color="#2f6f9f")
                panel.annotate(tissue, (begin, 1.01), xycoords=("data", "axes fraction"), rotation=30, fontsize=7)
            panel.set_xlabel("depth of the needle (mm)")
            panel.set_ylabel("force (N)")
            panel.legend(title=curve.name)
