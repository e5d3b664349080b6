"""The live simulator's latency: a scripted insertion through the real WebSocket, then by keyboard in a browser."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._extras import require
from .._markdown import table_of
from ..server import wire
from . import promises
from .browser import NoBrowserError, pose_to_drawn_ms

_RATE_HZ = 60.0
_SPEED_MM_S = 20.0
WARM_UP_S = 1.0
_PATIENCE_S = 60.0
"""A machine so busy that no pose came back in time gets so long for the first one."""


@dataclass
class Page:
    """What a page without a screen has seen."""

    sent: dict[int, float] = field(default_factory=dict)
    columns: dict[str, list[float]] = field(default_factory=dict)
    frames: int = 0
    out_of_order: int = 0
    seq: int = -1
    began: float = 0.0

    def see(self, header: dict[str, Any], bytes_: int) -> None:
        """Take note of a frame; the metrics are of frames that show a new pose."""
        now = time.perf_counter()
        self.frames += 1
        if header["seq"] <= self.seq:
            self.out_of_order += header["seq"] < self.seq
            return
        self.seq = header["seq"]
        if self.seq not in self.sent or self.sent[self.seq] < self.began + WARM_UP_S:
            return
        metrics = {
            "server_ms": header["server_ms"], "step_ms": header["step_ms"], "render_ms": header["render_ms"],
            "round_trip_ms": 1e3 * (now - self.sent[self.seq]), "kilobytes": bytes_ / 1000,
        }  # fmt: skip
        for name, value in metrics.items():
            self.columns.setdefault(name, []).append(value)


def measure(scene: str, seconds: float) -> dict[str, Any]:
    """Return medians and 95th percentiles of a scripted insertion, pull-back and sweep of so many seconds."""
    with serving(scene) as (address, _):
        page, model = asyncio.run(drive(socket_of(address), seconds))
    if not page.columns:
        raise RuntimeError(f"no frame showed a new pose within {seconds:g} s; measure for longer")
    rows = {name: _row(values) for name, values in page.columns.items()}
    not_measured = None
    try:
        with serving(scene) as (address, _):
            rows["pose_to_drawn_ms"] = _row(pose_to_drawn_ms(address, seconds))
    except NoBrowserError as error:
        not_measured = f"pose to frame drawn: {error}"
    return {
        "scene": scene, "model": model, "seconds": seconds, "frames": page.frames,
        "frames_a_second": page.frames / seconds, "out_of_order": page.out_of_order, "latency": rows,
        "claims": promises.of_the_simulator(rows, page.out_of_order), "not_measured": not_measured,
    }  # fmt: skip


def report(results: dict[str, Any]) -> str:
    """Return the results as Markdown."""
    latency = [row | {"name": name.replace("_", " ")} for name, row in results["latency"].items()]
    parts = [
        f"{results['scene']}, {results['model']}: {results['frames']} frames in {results['seconds']:g} s",
        table_of(latency, " | median | 95 % | frames", "{name} | {median:.1f} | {p95:.1f} | {frames}"),
        promises.table_of_promises(results["claims"]),
    ]
    if results["not_measured"]:
        parts.append(f"Not measured: {results['not_measured']}")
    return "\n\n".join(parts)


def _row(values: list[float]) -> dict[str, Any]:
    if not values:
        raise RuntimeError("no pose was drawn in the browser; measure for longer")
    return {"median": float(np.median(values)), "p95": float(np.quantile(values, 0.95)), "frames": len(values)}


@contextmanager
def serving(scene: str, **environment: str) -> Iterator[tuple[str, int]]:
    """Yield the address and the process id of a server of its own, with these variables in its environment."""
    command = [sys.executable, "-m", "sonospline", "serve", "--port", "0", "--json", "--scene", scene]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | environment)
    try:
        assert server.stdout is not None
        line = server.stdout.readline()
        if not line:
            raise RuntimeError(f"the server did not start (exit code {server.wait(10)}); see what it said")
        yield json.loads(line)["address"], server.pid
    finally:
        server.terminate()
        server.wait(30)
        assert server.stdout is not None
        server.stdout.close()


def socket_of(address: str) -> str:
    """Return the address of a server's WebSocket."""
    return address.replace("http://", "ws://") + "live"


async def drive(url: str, seconds: float) -> tuple[Page, str]:
    """Push the needle in and back out for so long; return what a page saw meanwhile, and the scene's model."""
    websockets, page = require("websockets"), Page()
    async with websockets.connect(url, max_size=2**24, compression=None) as socket:
        scene = await first_scene(socket)
        page.began = time.perf_counter()
        pushing = asyncio.create_task(_push(socket, scene, page))
        try:
            while (spent := time.perf_counter() - page.began) < seconds or (not page.columns and spent < _PATIENCE_S):
                message = await socket.recv()
                if isinstance(message, bytes):
                    kind, header, _ = wire.read(message)
                    if kind == wire.FRAME:
                        page.see(header, len(message))
                        await socket.send(json.dumps({"type": "drawn", "frame": header["frame"]}))
        finally:
            pushing.cancel()
            await asyncio.gather(pushing, return_exceptions=True)
    return page, scene["model"]


async def first_scene(socket: Any) -> dict[str, Any]:
    """Return the scene message that a page waits for."""
    while True:
        message = await socket.recv()
        if isinstance(message, str):
            said: dict[str, Any] = json.loads(message)
            if said["type"] == "scene":
                return said
            if said["type"] == "refused":
                raise RuntimeError(f"the scene was refused: {said['message']}")


async def _push(socket: Any, scene: dict[str, Any], page: Page) -> None:
    """Push the needle two thirds of its length in and back out, again and again, 60 poses a second."""
    seq, state, most = 0, scene["state"], 2 / 3 * scene["needle"]["length_mm"]
    while True:
        seq += 1
        way = _SPEED_MM_S * (time.perf_counter() - page.began)
        state["needle"]["depth"] = most - abs(way % (2 * most) - most)
        page.sent[seq] = time.perf_counter()
        await socket.send(json.dumps({"type": "command", "seq": seq, **state}))
        await asyncio.sleep(1 / _RATE_HZ)
