"""Long use of the live simulator: does memory stay flat, do frames stay in order, do threads end."""

from __future__ import annotations

import asyncio
import copy
import json
import random
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sonospline._extras import require
from sonospline.bench.live import first_scene, serving, socket_of
from sonospline.server import wire

WARM_UP_SHARE = 0.2
"""Of the time: caches fill and every model is made once."""
_SAMPLE_S = 0.5
_VISIT_S = 20.0
"""A page is reloaded after so long; every third one vanishes without a word."""


@dataclass
class Log:
    """What was seen."""

    frames: int = 0
    out_of_order: int = 0
    refused: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    visits: int = 0
    memory: list[tuple[float, float]] = field(default_factory=list)
    """Seconds, and the server's resident megabytes."""


def soak(scene: str, seconds: float, *, seed: int = 0, visit_s: float = _VISIT_S) -> dict[str, Any]:
    """Use a server in every way for so many seconds; return what became of it."""
    with serving(scene) as (address, process):
        log = Log()
        threads = asyncio.run(_soak(socket_of(address), process, seconds, log, random.Random(seed), visit_s))
    times, memory = np.array(log.memory).T
    settled = times > WARM_UP_SHARE * seconds
    early, late = (float(np.median(part)) for part in np.array_split(memory[settled], 4)[::3])
    return {
        "scene": scene, "seconds": seconds, "visits": log.visits, "frames": log.frames,
        "out_of_order": log.out_of_order, "refused": log.refused, "faults": log.faults,
        "memory_mb": {"first_quarter": early, "last_quarter": late, "ratio": late / early, "most": float(memory.max())},
        "threads": {"before": threads[0], "after": threads[1]},
    }  # fmt: skip


async def _soak(
    url: str, process: int, seconds: float, log: Log, chance: random.Random, visit_s: float
) -> tuple[int, int]:
    await _visit(url, time.monotonic() + 1.0, log, chance)
    before = await _threads_at_rest(process)
    began = time.monotonic()
    watching = asyncio.create_task(_watch(process, began, log))
    while (now := time.monotonic()) < began + seconds:
        await _visit(url, min(now + visit_s, began + seconds), log, chance)
    watching.cancel()
    return before, await _threads_at_rest(process)


async def _visit(url: str, until: float, log: Log, chance: random.Random) -> None:
    """Open a page, use it, and leave: politely, or by vanishing with frames in flight."""
    log.visits += 1
    connection = require("websockets").connect(url, max_size=2**24, compression=None)
    async with connection as socket:
        scene = await first_scene(socket)
        using = asyncio.create_task(_use(socket, scene, chance))
        seen = 0
        while time.monotonic() < until:
            message = await socket.recv()
            if isinstance(message, str):
                _note(json.loads(message), log)
                continue
            kind, header, _ = wire.read(message)
            if kind == wire.FRAME:
                log.frames += 1
                log.out_of_order += header["frame"] <= seen
                seen = header["frame"]
                await socket.send(json.dumps({"type": "drawn", "frame": seen}))
        using.cancel()
        await asyncio.gather(using, return_exceptions=True)
        if log.visits % 3 == 0:
            socket.transport.abort()


def _note(said: dict[str, Any], log: Log) -> None:
    if said["type"] == "refused":
        log.refused.append(said["message"])
    if said["type"] == "notice":
        log.faults.append(said["message"])


async def _use(socket: Any, scene: dict[str, Any], chance: random.Random) -> None:
    """Thirty commands a second; now and then another model, an undo, a reset, a look at the grid."""
    start, seq = scene["state"], 0
    limits = {knob["id"]: (knob["low"], knob["high"]) for knob in scene["knobs"]}
    state = copy.deepcopy(start)
    commands: list[dict[str, Any]] = [{"type": "model", "model": model["id"]} for model in scene["models"]]
    commands += [{"type": "undo_pass"}, {"type": "reset"}, {"type": "view", "grid": True}]
    commands += [{"type": "view", "grid": False}, {"type": "target", "id": scene["targets"][-1]["id"]}]
    depth = 0.0
    while True:
        seq += 1
        depth = (depth + chance.uniform(0, 3)) % (0.6 * limits["needle.depth"][1])
        state["needle"]["depth"] = depth
        if seq % 15 == 0:
            for part, name in (("probe", "sweep"), ("probe", "fan"), ("image", "gain"), ("image", "depth")):
                low, high = limits[f"{part}.{name}"]
                state[part][name] = start[part][name] + chance.uniform(-0.1, 0.1) * (high - low)
        state["frozen"] = seq % 100 > 95
        await socket.send(json.dumps({"type": "command", "seq": seq, **state}))
        if seq % 40 == 0:
            await socket.send(json.dumps(chance.choice(commands)))
            depth = 0.0
        await asyncio.sleep(1 / 30)


async def _watch(process: int, began: float, log: Log) -> None:
    while True:
        log.memory.append((time.monotonic() - began, _status(process, "VmRSS") / 1024))
        await asyncio.sleep(_SAMPLE_S)


async def _threads_at_rest(process: int) -> int:
    """Threads of the server once those of sessions had time to end."""
    count = _status(process, "Threads")
    for _ in range(40):
        await asyncio.sleep(0.1)
        count = min(count, _status(process, "Threads"))
    return count


def _status(process: int, name: str) -> int:
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1])
    raise RuntimeError(f"/proc/{process}/status has no {name}; the soak needs Linux")
