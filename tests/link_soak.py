"""A page's session and a well-behaved client beside rude ones: what became of them."""

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from link_client import LinkClient
from link_rudeness import be_rude
from sonospline import Session
from sonospline.link import PageLink
from sonospline.simulator import Console, Runner

SAMPLES = 200


def memory_mb():
    """Resident, of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def resources():
    """Threads and open files."""
    return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))


def soak(seconds, headers, scene):
    """Let them be rude; return what became of the link."""
    console, errors = Console(Session(scene)), []
    with PageLink(port=0) as link, Runner(console) as runner:
        runner.subscribe(lambda frame, stamp: None, on_error=errors.append)
        link.watch(runner)
        with LinkClient(link.server.port) as client, ThreadPoolExecutor(2) as pool:
            client.wait_for("IMAGE", seconds=60)
            before, rude = (
                resources(),
                [pool.submit(be_rude, link.server.port, seconds, n, headers // 2) for n in (1, 2)],
            )
            latest, gap, memory, images = time.monotonic(), 0.0, [], 0
            while not all(each.done() for each in rude):
                client.wait_for("IMAGE", seconds=30)
                now = time.monotonic()
                gap, latest, images = max(gap, now - latest), now, images + 1
                memory.append(memory_mb())
                runner.submit(console.scene.start.with_needle(depth=5 + images % 20), images)
        deadline = time.monotonic() + 10
        while link.server.clients and time.monotonic() < deadline:
            time.sleep(0.05)
        after, left = resources(), len(link.server.clients)
        sent = sum(each.result() for each in rude)
    early, late = (sorted(part)[len(part) // 2] for part in (memory[len(memory) // 10 :][:SAMPLES], memory[-SAMPLES:]))
    return {
        "messages": sent, "images": images, "longest_gap_s": gap, "memory_mb": [early, late], "clients_left": left,
        "threads_and_files": [before, after], "errors": errors[:3],
    }  # fmt: skip


def leaks(found):
    """What is left over afterwards, in words; memory may grow by a tenth and 20 MB."""
    early, late = found["memory_mb"]
    (threads, files), (threads_after, files_after) = found["threads_and_files"]
    kept = {
        "errors": found["errors"], "clients": found["clients_left"], "memory": late >= 1.1 * early + 20,
        "threads": threads_after > threads + 1, "files": files_after > files + 1,
    }  # fmt: skip
    return [name for name, is_left in kept.items() if is_left]
