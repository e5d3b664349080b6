"""Makes the pictures of the ultrasound page.

    python docs/make_ultrasound_gallery.py [--data ../shared/data]

Pictures made from real data need the folder of real data; without it they are left as they are.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import sonospline as ss
from sonospline.fields import NodeSlice, PlaneSlice
from sonospline.geometry import ImagePlane, facing
from sonospline.io.canvas import blank
from sonospline.io.volumes import read_volume
from sonospline.phantoms import kidney_phantom, wide_kidney_phantom
from sonospline.phantoms.generated import gel_block
from sonospline.ultrasound import (
    Artefacts,
    Display,
    Doppler,
    Frame,
    Phantom,
    Probe,
    Reslicer,
    Scanner,
    swept,
)
from sonospline.ultrasound.organs import phantom_from_organs

IMAGES = Path(__file__).parent / "images"
REAL: dict[str, Any] = {"artefacts": Artefacts(), "display": Display(noise_db=-70)}
"""As the simulator's scenes show them."""


def pair(before: Frame, after: Frame, name: str, needle: ss.Needle | None = None) -> None:
    """Two frames side by side."""
    rows, columns = before.pixels.shape
    figure = blank(13, 0.6 + 6.3 * rows / columns)
    for panel, frame, title in zip(figure.subplots(1, 2), (before, after), ("before", "after"), strict=True):
        frame.plot(panel, vmin=0, vmax=255, needle=needle if title == "after" else None)
        panel.set_title(title)
        left, right, bottom, top = frame.plane.extent
        panel.set_xlim(left, right)
        panel.set_ylim(bottom, top)
    figure.savefig(IMAGES / name, dpi=85)


def kidney() -> None:
    """The kidney phantom under both probes, before and after the needle."""
    kidney = kidney_phantom()
    insertion = ss.Insertion(ss.Tissue(kidney.grid(), entry_face="z-"))
    scanner = Scanner(kidney.phantom, Probe.curvilinear(), kidney.probe_to_reference, **REAL)
    field = ss.GridField.of(insertion.advance(kidney.needle))
    pair(scanner.render().frame, scanner.render(field, kidney.needle).frame, "ultrasound_kidney_curvilinear.png")

    unpressed = kidney_phantom(pressed=False)
    probe = Probe.linear(depth_mm=48, aperture_mm=50)
    linear = Scanner(unpressed.phantom, probe, facing((112, 50, 0.6), depth=(0, 0, 1), right=(1, 0, 0)), **REAL)
    shallow = ss.Needle((150, 50, 1), (100, 50, 27))
    field = ss.GridField.of(insertion.advance(shallow))
    pair(linear.render().frame, linear.render(field, shallow).frame, "ultrasound_flank_linear.png")


def flow() -> None:
    """The gel's vessel: grey, and by colour Doppler of enough pulses a second, and of too few."""
    phantom = gel_block(0.5).phantom
    probe = Probe.linear(depth_mm=40, elevation_focus_mm=22)
    still = Scanner(phantom, probe, facing((60, 30, 0), depth=(0, 0, 1), right=(1, 0, 0)), **REAL)
    box = Doppler(box_mm=(-10, 10, 16, 32), steer_deg=20)
    figure = blank(15, 4.6)
    titles = ("grey", "4500 pulses a second", "2500: the middle aliases")
    seen = [still, *(still.with_doppler(replace(box, prf_hz=prf)) for prf in (4500, 2500))]
    for panel, scanner, title in zip(figure.subplots(1, 3), seen, titles, strict=True):
        scanner.render().plot(panel)
        panel.set_title(title)
    figure.savefig(IMAGES / "ultrasound_flow.png", dpi=85)


def textures() -> None:
    """Four tissues without and with their textures."""
    figure = blank(16, 9.2)
    pose = facing((30, 12, 0), depth=(0, 0, 1), right=(1, 0, 0))
    names = ("muscle", "fat", "liver", "kidney cortex")
    for row, panels in enumerate(figure.subplots(2, 4)):
        for panel, name in zip(panels, names, strict=True):
            phantom = Phantom.uniform(name, size_mm=(60, 24, 50))
            seen = phantom.textured() if row else phantom
            Scanner(seen, Probe.linear(frequency_mhz=6, depth_mm=42), pose, **REAL).render().plot(panel)
            panel.set_title(name)
    figure.savefig(IMAGES / "ultrasound_textures.png", dpi=70)


def wide_kidney() -> None:
    """Across and along the kidney with nothing around it, and with its neighbours; and where the pleura begins."""
    across = facing((62, 58, 8), depth=(0, 0, 1), right=(0, 1, 0))
    wide = wide_kidney_phantom().phantom
    seen = [
        Scanner(phantom, Probe.curvilinear(depth_mm=125), across, **REAL).render().frame
        for phantom in (kidney_phantom().phantom, wide.textured())
    ]
    pair(*seen, "ultrasound_kidney_wide.png")
    medulla = [
        Scanner(phantom, Probe.curvilinear(), kidney_phantom().probe_to_reference, **REAL).render().frame
        for phantom in (kidney_phantom().phantom, wide.textured())
    ]
    pair(*medulla, "ultrasound_medulla.png")
    cranial = facing((6, 50, 2), depth=(0, 0, 1), right=(-1, 0, 0))
    pleura = [
        Scanner(phantom, Probe.curvilinear(depth_mm=125), cranial, **REAL).render().frame
        for phantom in (kidney_phantom(pressed=False).phantom, wide_kidney_phantom(pressed=False).phantom.textured())
    ]
    pair(*pleura, "ultrasound_pleura.png")


def slices() -> None:
    """The paper's slice and the continuous one."""
    field = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25))).advance(needle := ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5)))
    plane = ImagePlane.crossing(field.grid, normal=(0, 0, 1), through=(0.5, 0.5, 0.5))
    figure = blank(12, 5)
    left, right = figure.subplots(1, 2)
    NodeSlice.of(field, at=0.5).plot(left, needle=needle)
    PlaneSlice.of(field, plane).plot(right, needle=needle, lines_mm=0.05)
    figure.savefig(IMAGES / "ultrasound_slices.png", dpi=85)


def abdomen(data: Path) -> None:
    """A phantom from labelled CT: the right kidney from the flank, in an axial plane."""
    labels, ct = ss.read_labels(data / "abdomen_labels.nii.gz"), read_volume(data / "abdomen_ct.nii.gz")
    phantom = phantom_from_organs(labels, ct=ct)
    kidney_middle = labels.position(np.argwhere(labels.voxels == 2).mean(axis=0)[None])[0]
    look = np.array([-0.55, 0.835, 0.0])  # from behind and the side
    skin = kidney_middle.copy()
    while phantom.labels.lattice.contains((skin - 2 * look)[None]).all():
        index = np.rint(phantom.labels.lattice.local(skin[None])[0] / phantom.labels.lattice.spacing).astype(int)
        if phantom.bytes[tuple(index)] == 0:
            break
        skin = skin - look
    pose = facing(skin + 3 * look, depth=look, right=np.cross(look, (0, 0, 1)))
    scanner = Scanner(phantom, Probe.curvilinear(depth_mm=130), pose, **REAL)
    lattice = phantom.labels.lattice
    grid = ss.Grid.covering(lattice.extent, nodes=150_000, origin=lattice.origin)
    needle = ss.Needle(skin + 14 * look + 42 * pose[:3, 0], kidney_middle)
    tissue = ss.Tissue(grid, entry_face=grid.nearest_face(needle.entry))
    insertion = ss.Insertion(tissue, ss.NeedleTissueModel.paper(60.0))
    field = ss.GridField.of(insertion.advance(needle))
    pair(scanner.render().frame, scanner.render(field, needle).frame, "ultrasound_abdomen.png")


def sweep(data: Path) -> None:
    """A real tracked sweep, cut along a plane while a needle moves, and what it never saw."""
    volume = read_volume(data / "spine_phantom_us.mha")
    grid = volume.grid(150_000)
    entry, tip = grid.world(np.array([[36.0, 0, 25], [36, 34, 25]]))
    field = ss.GridField.of(ss.Insertion(ss.Tissue(grid, entry_face="y-")).advance(needle := ss.Needle(entry, tip)))
    plane = ImagePlane.crossing(grid, normal=grid.direction[:, 2], through=tip, right=grid.direction[:, 0])
    reslicer = Reslicer(volume, seen=swept(volume))
    pair(reslicer.cut(plane), reslicer.cut(plane, field), "ultrasound_sweep.png", needle)


def liver(data: Path) -> None:
    """Real liver beside a synthetic one: the same display law, divided by the local mean."""
    from scipy.ndimage import gaussian_filter

    image = read_volume(data / "liver_speckle.mha")
    order = np.argsort(image.voxels.shape)  # frames, lines, samples
    frames = np.transpose(image.voxels, order).astype(float)
    spacing = np.array(image.lattice.spacing)[order]
    real = frames[len(frames) // 2].T
    width, depth = float(spacing[1] * (real.shape[1] - 1)), float(spacing[2] * 512)
    probe = Probe.linear(
        frequency_mhz=7.5, f_number=2.3, lines=real.shape[1], samples=512, depth_mm=depth, aperture_mm=width
    )
    phantom = Phantom.uniform("liver", size_mm=(60, 20, 40))
    pose = facing((30, 10, 2), depth=(0, 0, 1), right=(1, 0, 0))
    rendered = Scanner(phantom, probe, pose, display=Display(noise_db=-150)).render()
    gain = 10 ** (2 * 0.5 * probe.frequency_mhz * probe.ranges / 10 / 20)
    envelope = (rendered.envelope * gain).T
    synthetic = np.log1p(envelope / (5 * envelope.mean()))
    size = (2.0 / spacing[2], 2.0 / spacing[1])
    figure = blank(11, 4.6)
    panels = figure.subplots(1, 3)
    extent = (0, real.shape[1] * spacing[1], real.shape[0] * spacing[2], 0)
    for panel, grey, title in zip(panels, (real, synthetic), ("real liver", "synthetic liver"), strict=False):
        local = gaussian_filter(grey, size)
        flat = (grey / np.maximum(local, 1e-3))[130:380, 8:-8]  # the middle: not saturated, and seldom cut to black
        panel.imshow(grey / np.maximum(local, 0.05 * local.max()), cmap="gray", vmin=0, vmax=2.2, extent=extent)
        panel.set(title=f"{title}, over its local mean", xlabel="mm", ylabel="mm")
        skew = float(np.mean((flat - flat.mean()) ** 3) / flat.std() ** 3)
        widths = [_width(flat, axis) * spacing[2 - axis] for axis in (0, 1)]
        label = (
            f"{title}: SNR {flat.mean() / flat.std():.2f}, skewness {skew:.2f}, {widths[0]:.2f} x {widths[1]:.2f} mm"
        )
        panels[2].hist(flat.ravel(), bins=80, range=(0, 3), density=True, histtype="step", label=label)
        print(label)
    panels[2].set(title="grey over local mean", xlabel="ratio", ylim=(0, 1.05))  # room for the legend
    panels[2].legend(fontsize=6)
    figure.savefig(IMAGES / "ultrasound_liver.png", dpi=85)


def _width(grey: np.ndarray, axis: int) -> float:
    """Full width at half maximum of the autocovariance along an axis, in samples."""
    grey = np.moveaxis(grey - grey.mean(), axis, 0)
    lags = np.array([np.mean(grey[: len(grey) - k] * grey[k:]) for k in range(30)])
    lags /= lags[0]
    below = int(np.flatnonzero(lags < 0.5)[0])
    return 2 * (below - 1 + (lags[below - 1] - 0.5) / (lags[below - 1] - lags[below]))


PICTURES = {"slices": slices, "kidney": kidney, "flow": flow, "textures": textures, "wide kidney": wide_kidney}
REAL_DATA = {"abdomen": abdomen, "sweep": sweep, "liver": liver}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    parser.add_argument("--only", choices=(*PICTURES, *REAL_DATA))
    arguments = parser.parse_args()
    for name, picture in PICTURES.items():
        if arguments.only in (None, name):
            picture()
    for name, real in REAL_DATA.items():
        if arguments.only in (None, name) and arguments.data.is_dir():
            real(arguments.data)


if __name__ == "__main__":
    main()
