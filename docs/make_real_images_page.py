"""Makes the page that puts real and simulated images side by side.

    python docs/make_real_images_page.py [--data ../shared/data]

Of the real images the page holds numbers alone; without the folder of real data nothing is made.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import sonospline as ss
from sonospline.geometry import Volume, facing
from sonospline.io.canvas import blank
from sonospline.io.volumes import read_volume
from sonospline.ultrasound import AcousticTissue, Artefacts, Display, Frame, NeedleEcho, Phantom, Probe, Scanner

HERE = Path(__file__).parent
CLEAN, REAL = Artefacts.none(), Artefacts()
NOISE_DB = -70.0
Row = tuple[str, str, str, str]


def from_above(x: float, y: float, z: float) -> np.ndarray:
    """A pose at a point, looking along z."""
    return facing((x, y, z), depth=(0, 0, 1), right=(1, 0, 0))


# --- speckle ---


def real_speckle(data: Path) -> tuple[np.ndarray, np.ndarray]:
    """The middle frame of real liver (samples, lines), and its spacing along them, mm."""
    image = read_volume(data / "liver_speckle.mha")
    order = np.argsort(image.voxels.shape)
    frames, spacing = np.transpose(image.voxels, order).astype(float), np.array(image.lattice.spacing)[order]
    return frames[len(frames) // 2].T, spacing[[2, 1]]


def simulated_speckle(like: np.ndarray, spacing: np.ndarray, artefacts: Artefacts) -> np.ndarray:
    """Liver as the same scanner would show it: its law is about ln(1 + envelope / e0)."""
    samples, lines = like.shape
    probe = Probe.linear(
        frequency_mhz=7.5, f_number=2.3, lines=lines, samples=samples, depth_mm=float(spacing[0] * samples),
        aperture_mm=float(spacing[1] * (lines - 1)),
    )  # fmt: skip
    phantom = Phantom.uniform("liver", size_mm=(60, 20, 40))
    display = Display(noise_db=NOISE_DB)
    image = Scanner(phantom, probe, from_above(30, 10, 2), display=display, artefacts=artefacts).render()
    gain = 10 ** (2 * 0.5 * probe.frequency_mhz * probe.ranges / 10 / 20)
    envelope = (image.envelope * gain).T
    return np.log1p(envelope / (5 * envelope.mean()))


def over_local_mean(grey: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Grey of the middle over its mean within 2 mm: one image's gain says nothing about the other's."""
    from scipy.ndimage import gaussian_filter

    return (grey / np.maximum(gaussian_filter(grey, tuple(2.0 / spacing)), 1e-3))[130:380, 8:-8]


def width(grey: np.ndarray, axis: int) -> float:
    """Full width at half maximum of the autocovariance, samples."""
    grey = np.moveaxis(grey - grey.mean(), axis, 0)
    lags = np.array([np.mean(grey[: len(grey) - k] * grey[k:]) for k in range(30)])
    lags /= lags[0]
    below = int(np.flatnonzero(lags < 0.5)[0])
    return 2 * (below - 1 + (lags[below - 1] - 0.5) / (lags[below - 1] - lags[below]))


def speckle(data: Path) -> list[Row]:
    real, spacing = real_speckle(data)
    parts = [
        over_local_mean(grey, spacing) for grey in (real, *(simulated_speckle(real, spacing, a) for a in (CLEAN, REAL)))
    ]
    share = [np.histogram(part, bins=60, range=(0, 3))[0] / part.size for part in parts]
    distance = [0.5 * np.abs(one - share[0]).sum() for one in share]
    sizes = [f"{width(part, 0) * spacing[0]:.2f} x {width(part, 1) * spacing[1]:.2f}" for part in parts]
    snr = [f"{part.mean() / part.std():.2f}" for part in parts]
    return [
        ("speckle: distance of histograms (half the sum of differences)", "0", *(f"{d:.3f}" for d in distance[1:])),
        ("speckle: width of the autocovariance, mm", *sizes),
        ("speckle: mean over standard deviation", *snr),
    ]  # type: ignore[list-item]


# --- a capsule from all sides ---

OIL = AcousticTissue(name="oil", speed_m_s=1400, density_kg_m3=900, attenuation_db_cm_mhz=0, backscatter_db=-200)


def capsule(degrees: float, artefacts: Artefacts) -> float:
    """Level of a surface between two fluids, seen so far from square, dB."""
    voxels = np.zeros((90, 30, 60), np.uint8)
    voxels[:, :, 24:] = 1
    phantom = Phantom(Volume(voxels=voxels, spacing=(1, 1, 1)), {0: replace(OIL, density_kg_m3=850), 1: OIL})
    tilt = np.radians(degrees)
    depth = np.array([np.sin(tilt), 0, np.cos(tilt)])
    pose = facing(np.array([45, 15, 23.5]) - 22 * depth, depth=depth, right=(np.cos(tilt), 0, -np.sin(tilt)))
    probe = Probe.linear(depth_mm=50, lines=64, aperture_mm=25)
    image = Scanner(phantom, probe, pose, display=Display(noise_db=-150), artefacts=artefacts).render()
    return float(10 * np.log10(np.mean(np.square(image.envelope[20:44]).max(axis=1))))


def capsules() -> list[Row]:
    rows = []
    only = replace(CLEAN, diffuse=True)
    square = {artefacts: capsule(0, artefacts) for artefacts in (CLEAN, only)}
    for degrees in (30, 60):
        below = [f"{capsule(degrees, artefacts) - square[artefacts]:.1f}" for artefacts in (CLEAN, only)]
        rows.append((f"capsule at {degrees} degrees, dB below square", "-12 to -18 wanted", *below))
    return rows  # type: ignore[return-value]


# --- a small cyst ---


def cyst(artefacts: Artefacts, harmonic: bool = False) -> tuple[Frame, np.ndarray]:
    """A cyst of 7 mm at 6 cm in liver, and the grey levels well inside it."""
    x, y, z = np.ogrid[:201, :41, :181]
    voxels = np.zeros((201, 41, 181), np.uint8)
    voxels[(x / 2 - 50) ** 2 + (y / 2 - 10) ** 2 + (z / 2 - 64) ** 2 < 3.5**2] = 1
    phantom = Phantom(Volume(voxels=voxels, spacing=(0.5,) * 3), {0: "liver", 1: "urine"})
    probe = Probe.curvilinear(depth_mm=80, lines=128, aperture_mm=40)
    probe = probe.in_harmonic_mode() if harmonic else probe
    display = Display(noise_db=NOISE_DB if artefacts.haze_db is not None else -76, tgc_db_cm_mhz=0.5)
    image = Scanner(phantom, probe, from_above(50, 10, 4), display=display, artefacts=artefacts).render()
    at = round(60 / probe.sample_mm)
    half = round(1.2 / probe.sample_mm)
    return image.frame, image.beams[61:67, at - half : at + half]


def cysts() -> list[Row]:
    grey = [cyst(CLEAN)[1], cyst(REAL)[1], cyst(REAL, harmonic=True)[1]]
    shown = [f"{part.mean():.0f} ({np.quantile(part, 0.1):.0f} to {np.quantile(part, 0.9):.0f})" for part in grey]
    return [("grey inside a 7 mm cyst at 6 cm (liver: 122)", "not 0", shown[0], f"{shown[1]}; harmonic {shown[2]}")]


# --- under the face ---


def near_field(data: Path) -> list[Row]:
    """How the grey of a probe in air falls: share of the rows that are brighter than half way down to the noise."""
    real = read_picture(data / "linear_bmode.igs.mha")
    held = real[(real.mean(axis=1) > 0)][:, real.mean(axis=0) > 0]

    def band(rows: np.ndarray) -> str:
        rows = np.convolve(rows, np.ones(9) / 9, mode="valid")
        floor = np.median(rows[len(rows) // 2 :])
        above = np.flatnonzero(rows > (rows.max() + floor) / 2)
        return f"{rows.max():.0f} over {floor:.0f}, {100 * (above.max() + 1) / len(rows):.0f} % of the depth"

    def in_air(artefacts: Artefacts) -> np.ndarray:
        probe = Probe.linear(depth_mm=40)
        phantom = Phantom.uniform("gel", size_mm=(60, 10, 50))
        return Scanner(
            phantom, probe, from_above(30, 5, 1), display=Display(noise_db=NOISE_DB), artefacts=artefacts
        ).render().beams.mean(axis=0)  # fmt: skip

    what = "near-field band in air: grey at its brightest, of the noise, and how deep"
    return [(what, band(held.mean(axis=1)), *(band(in_air(artefacts)) for artefacts in (CLEAN, REAL)))]  # type: ignore[list-item]


def read_picture(path: Path) -> np.ndarray:
    """One grey frame without calibration."""
    return Frame.read(path, spacing_mm=0.1, probe_to_reference=np.eye(4)).pixels.astype(float)


# --- the needle ---


def needle_image(beta_deg: float, artefacts: Artefacts, model: NeedleEcho, seed: int = 0) -> Any:
    probe = Probe.linear(depth_mm=40, lines=160, aperture_mm=32)
    phantom = Phantom.uniform("liver", size_mm=(60, 30, 50))
    beta = np.radians(beta_deg)
    along = 11 * np.array([np.cos(beta), 0, np.sin(beta)])
    middle = np.array([30.0, 15.0, 24.0])
    scanner = Scanner(
        phantom, probe, from_above(30, 15, 4), display=Display(tgc_db_cm_mhz=0.5, noise_db=-150), needle_echo=model,
        artefacts=artefacts, seed=seed,
    )  # fmt: skip
    return scanner.render(None, ss.Needle(middle - along, middle + along))


def along_shaft(beta_deg: float, artefacts: Artefacts, model: NeedleEcho, seed: int = 0) -> np.ndarray:
    """The loudest echo near the shaft on each beam, dB over liver."""
    image = needle_image(beta_deg, artefacts, model, seed)
    probe = image.optics.probe
    lines = np.arange(40, 120)
    x = (lines - (probe.lines - 1) / 2) * probe.line_step
    at = np.rint((20 + x * np.tan(np.radians(beta_deg))) / probe.sample_mm).astype(int)
    return np.array(
        [20 * np.log10(image.envelope[line, a - 12 : a + 12].max()) for line, a in zip(lines, at, strict=True)]
    )


def needles(data: Path) -> list[Row]:
    with (data / "needle_visibility.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["needle"] == "Trocar_18G"]
    beta = np.array([float(row["angle_deg"]) for row in rows]) - NeedleEcho.trocar().centre_deg
    cnr = np.array([float(row["shaft_cnr_median"]) for row in rows])
    spread = np.mean([float(row["shaft_cnr_std"]) / max(float(row["shaft_cnr_median"]), 0.1) for row in rows])
    near = np.abs(beta) < 50
    only, trocar = replace(CLEAN, needle=True), NeedleEcho.trocar()
    kept, uneven, gaps = [], [], []
    for artefacts in (CLEAN, only):
        levels = [along_shaft(b, artefacts, trocar).mean() for b in beta[near]]
        kept.append(f"r = {np.corrcoef(levels, cnr[near])[0, 1]:.2f}")
        shaft = np.concatenate([along_shaft(8, artefacts, trocar, seed) for seed in range(4)])
        uneven.append(f"{shaft.std():.1f} dB")
        gaps.append(f"{100 * np.mean(shaft < np.median(shaft) - 6):.0f} %")
    return [
        ("needle: brightness against the measured contrast, 18 G trocar, by angle", "r = 1", *kept),
        (
            "needle: standard deviation along its shaft",
            f"{100 * spread:.0f} % between insertions",
            *uneven,
        ),
        ("needle: share of the shaft that drops out, by 6 dB or more", "not measured", *gaps),
    ]  # type: ignore[list-item]


# --- the page ---


def picture() -> None:
    """What is simulated, without its artefacts above and with them below."""
    figure = blank(13, 7)
    panels = figure.subplots(2, 3)
    kidney = ss.kidney_phantom()
    for row, artefacts in zip(panels, (CLEAN, REAL), strict=True):
        name = "clean" if artefacts is CLEAN else "with artefacts"
        display = Display(noise_db=-76 if artefacts is CLEAN else NOISE_DB)
        scanner = Scanner(
            kidney.phantom, Probe.curvilinear(), kidney.probe_to_reference, display=display, artefacts=artefacts
        )
        frames = (
            scanner.render(None, kidney.needle).frame, cyst(artefacts)[0],
            needle_image(12, artefacts, NeedleEcho.trocar()).frame,
        )  # fmt: skip
        for panel, frame, what in zip(row, frames, ("kidney", "cyst of 7 mm", "18 G trocar"), strict=True):
            frame.plot(panel, vmin=0, vmax=255)
            panel.set(title=f"{what}, {name}", xlabel="", ylabel="")
    figure.savefig(HERE / "images" / "real_images.png", dpi=80)


TEXT = """# Beside real images

What `Artefacts` adds ({doc}`ultrasound`), against real data, under the same display law. The page holds what is
simulated, and of the real images numbers alone.

![Without artefacts above, with them below](images/real_images.png)

| statistic | real | clean beams | with artefacts |
| --- | --- | --- | --- |
TABLE

Real liver is ITKUltrasound's (display law about ln(1 + envelope / e0), divided by its local mean), the probe in air
PlusLib's (not calibrated: its depth is counted in parts of the picture), the needle's contrast by angle that of van de
Berg et al. 2018. No real image of a capsule, of a small cyst, or of one shaft along its length is at hand: there the
wanted value stands, and levels are set by eye. `python docs/make_real_images_page.py` makes this page.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data")
    data = parser.parse_args().data
    if not data.is_dir():
        parser.error(f"--data = {str(data)!r} is no folder; give that of the real data")
    rows = [*speckle(data), *capsules(), *cysts(), *near_field(data), *needles(data)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    print(table)
    picture()
    (HERE / "real_images.md").write_text(TEXT.replace("TABLE", table))


if __name__ == "__main__":
    main()
