"""Ultrasound in real time: frames, with the needle or the probe moving, slices of a volume, and the NumPy twin.

Curvilinear kidney phantom, 192 lines x 1024 samples to 512 x 512 pixels, field of 148,877 nodes or so. Prints
medians and minima of each, frames a second, the ratio of the twin to the core, and how far they differ.

    python benchmarks/ultrasound_renders_in_real_time.py [--threads 2] [--frames 60]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import sonospline as ss
from sonospline import _core
from sonospline.geometry import ImagePlane, facing
from sonospline.geometry.layered_block import default_needle, layered_block
from sonospline.phantoms import kidney_phantom
from sonospline.ultrasound import Probe, Reslicer, Scanner


def timed(name: str, frame: Callable[[int], object], count: int, target: float) -> None:
    """Print one line: a frame's time, and whether the median meets the target."""
    frame(0)
    times = []
    for number in range(count):
        start = time.perf_counter()
        frame(number)
        times.append(1e3 * (time.perf_counter() - start))
    median, least = np.median(times), min(times)
    print(f"{name:38s} {median:8.2f} {least:8.2f} {1e3 / median:10.0f} {1e3 / least:10.0f} {target:10.0f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=_core.native.thread_count())
    parser.add_argument("--frames", type=int, default=60)
    arguments = parser.parse_args()
    _core.native.set_thread_count(arguments.threads)
    start = time.perf_counter()
    kidney = kidney_phantom()
    print(
        f"{_core.instruction_set()}, {arguments.threads} threads; phantom built in {time.perf_counter() - start:.1f} s"
    )
    grid, needle = kidney.grid(148_877), kidney.needle
    insertion = ss.Insertion(ss.Tissue(grid, entry_face="z-"))
    steps = [ss.Needle(needle.entry, needle.at(t)) for t in np.linspace(0.5, 1.0, arguments.frames)]
    field = ss.GridField.of(insertion.advance(needle))
    scanner = Scanner(kidney.phantom, Probe.curvilinear(), kidney.probe_to_reference, picture_shape=(512, 512))
    start = time.perf_counter()
    scanner.render(field, needle)
    print(f"first frame in {time.perf_counter() - start:.2f} s; {grid.node_count:,} nodes")
    print(f"{'':38s} {'median':>8s} {'least':>8s} {'frames/s':>10s} {'at best':>10s} {'target':>10s}")
    count = arguments.frames
    timed("render only", lambda k: scanner.render(field, needle, frame=k), count, 100)

    def deform_and_render(k: int) -> object:
        return scanner.render(ss.GridField.of(insertion.advance(steps[k])), steps[k], frame=k)

    timed("deform and render, needle moving", deform_and_render, count, 60)

    def pose_at(offset: tuple[float, float, float]) -> NDArray[np.float64]:
        pose = kidney.probe_to_reference.copy()
        pose[:3, 3] += offset
        return pose

    def nudged(k: int) -> object:
        return scanner.moved(pose_at((0.3 * k, 0, 0))).render(field, needle)

    def jumped(k: int) -> object:
        return scanner.moved(pose_at((0, 8.0 * (k % 2), 0))).render(field, needle)

    def turned(k: int) -> object:
        return scanner.with_probe(replace(scanner.probe, depth_mm=100.0 + k % 20)).render(field, needle)

    timed("moved probe, first frame (50 ms)", nudged, count // 2, 20)
    timed("probe put elsewhere (150 ms)", jumped, count // 2, 1e3 / 150)
    timed("another depth (150 ms)", turned, count // 2, 1e3 / 150)
    block = layered_block()
    lattice = block.grid(148_877)
    entry_face = lattice.nearest_face(default_needle().entry)
    moved = ss.GridField.of(ss.Insertion(ss.Tissue(lattice, entry_face=entry_face)).advance(default_needle()))
    pose = facing((4, 4, 42), depth=(0, 1, 0), right=(1, 0, 0))
    plane = ImagePlane(image_to_reference=pose, shape=(512, 512), spacing_mm=0.145)
    reslicer = Reslicer(block)
    timed("slice of a volume, 512 x 512", lambda k: reslicer.cut(plane, moved), count, 240)
    core = scanner.render(field, needle, frame=1)
    _core.active = _core.twin
    other = Scanner(kidney.phantom, Probe.curvilinear(), kidney.probe_to_reference, picture_shape=(512, 512))
    twin = other.render(field, needle, frame=1)
    timed("render only, NumPy twin", lambda k: other.render(field, needle, frame=k), 5, 5)
    weight = 1 / np.sqrt(scanner.optics.speckle_power)
    difference = np.sqrt(np.mean(np.abs((core.iq - twin.iq) * weight) ** 2))
    print(f"core and twin differ by {difference / np.sqrt(np.mean(np.abs(twin.iq * weight) ** 2)):.1e} of the rms")


if __name__ == "__main__":
    main()
