"""Makes the tables of docs/ultrasound.md: what is checked, clean and with every part on, and the comparison with SIMUS.

    python docs/make_ultrasound_tables.py [--data ../shared/data]

Measures as the tests do. SIMUS needs `pip install pymust`.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import image_statistics as statistics
import needle_images
import simus_peer
from liver import CURVED, LINEAR
from sonospline.ultrasound import Artefacts

PAGE = Path(__file__).parent / "ultrasound.md"
WAYS = (Artefacts.none(), Artefacts())


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Rows in Markdown."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def checked(data: Path) -> str:
    """Every statistic by both probes, clean and with every part on."""
    columns = [(probe, parts) for probe in (LINEAR, CURVED) for parts in WAYS]
    images = [statistics.images_of(probe, parts) for probe, parts in columns]
    below = [0.0 if parts == WAYS[0] else statistics.HAZE_MM for _, parts in columns]
    chances = [[statistics.rayleigh_p(p, image) for image in i] for (p, _), i in zip(columns, images, strict=True)]
    levels = [
        statistics.level_along_depth(probe, i, top)
        for (probe, _), i, top in zip(columns, images, below, strict=True)
    ]  # fmt: skip
    widths = [[f"{100 * off:+.0f} %" for off in statistics.width_errors(*column)] for column in columns]
    twin = [f"{statistics.twin_difference(*column):.0e}" for column in columns]
    tracked = [np.array(statistics.tracked(parts)[0]) for parts in WAYS]
    follows = [np.corrcoef(*needle_images.brightness_by_angle(data, parts)[1:])[0, 1] for parts in WAYS]
    once = ["", ""]
    return table(
        ("", "wanted", "linear 7.5 MHz", "every part on", "curvilinear 3.5 MHz", "every part on"),
        [
            ("signal-to-noise ratio of the envelope (4 seeds)", "1.913",
             *(f"{statistics.signal_to_noise(i):.3f}" for i in images)),
            ("Kolmogorov-Smirnov against Rayleigh, least p of 4 seeds", "above 0.01",
             *(f"{min(p for p, _ in found):.2f} (n = {found[0][1]:,})" for found in chances)),
            ("axial, lateral width of the autocovariance, off by", "0", *(", ".join(w) for w in widths)),
            (f"mean level of liver along depth, dB (parts on: below {statistics.HAZE_MM:g} mm)", "0",
             *(f"{level.min():+.1f} to {level.max():+.1f}" for level in levels)),
            ("compiled core against NumPy twin, of the rms before compression", "below 1e-4", *twin),
            ("block matching between needle steps, median error (90 %), mm", "below 0.05",
             *(f"{np.median(error):.3f} ({np.quantile(error, 0.9):.3f})" for error in tracked), *once),
            ("brightness of a 2 mm steel shaft against the measured curve, correlation", "1",
             *(f"{r:.3f}" for r in follows), *once),
        ],
    )  # fmt: skip


def against_simus() -> str:
    """Widths of a point at three depths, and a cloud's speckle, by both simulators."""
    rows = []
    for name in simus_peer.ARRAYS:
        parameters, probe = simus_peer.array(name, *simus_peer.ARRAYS[name])
        for depth in simus_peer.DEPTHS[name]:
            found = simus_peer.point_spread(parameters, probe, depth)
            for what, (theirs, mine) in (("axial", found.axial), ("lateral", found.lateral)):
                shown = f"{theirs:.3f}", f"{mine:.3f}", f"{100 * (mine / theirs - 1):+.0f} %"
                rows.append((f"{name}, {depth} mm", f"{what} width of a point, mm", *shown))
        theirs, mine = simus_peer.speckle(parameters, probe, *simus_peer.CLOUDS[name])
        ratios = [envelope.mean() / envelope.std() for envelope in (theirs, mine)]
        shown = *(f"{ratio:.2f}" for ratio in ratios), f"{100 * (ratios[1] / ratios[0] - 1):+.0f} %"
        rows.append(
            (f"{name}, {simus_peer.CLOUDS[name][0]} mm", "mean over standard deviation of the envelope", *shown)
        )
        alike = np.corrcoef(theirs.ravel(), mine.ravel())[0, 1]
        rows.append(
            (f"{name}, {simus_peer.CLOUDS[name][0]} mm", "correlation of the envelopes", "", f"{alike:.2f}", "")
        )
    return table(("array, depth", "", "SIMUS", "ours", "off by"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments = parser.parse_args()
    page = PAGE.read_text()
    for name, made in (("checked", checked(arguments.data)), ("simus", against_simus())):
        mark = f"<!-- table: {name} -->"
        page, found = re.subn(f"{mark}\n\n(\\|.*\n)*", lambda _, mark=mark, made=made: f"{mark}\n\n{made}\n", page)
        assert found == 1, f"{PAGE} has no {mark}"
    PAGE.write_text(page)


if __name__ == "__main__":
    main()
