"""A run whose workers, scheduler or client are killed (kill -9) at random moments, resumed until it is complete.

Claim: after so many kills every hash is that of a run that nobody disturbed.

    python benchmarks/killed_at_any_moment_a_data_set_is_the_same.py [kills]

By default 100. Ends with 1 where a hash differs.
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from small_datasets import SMALL
from sonospline.dataset import DataSet, Specification, make_dataset

LONGEST_S = 4.0
VICTIMS = ("client", "scheduler", "worker")


class Cluster:
    """A scheduler and two workers as processes of their own, begun anew where they are gone."""

    def __init__(self, folder):
        self.folder, self.held, self.made = folder, {}, 0

    def up(self):
        if not alive(self.held.get("scheduler")):
            self.down()
            self.made += 1
            self.file = self.folder / f"scheduler-{self.made}.json"
            self.held["scheduler"] = begun("dask_scheduler", "--scheduler-file", self.file, "--port", "0")
        for name in ("worker 1", "worker 2"):
            if not alive(self.held.get(name)):
                place = ("--local-directory", self.folder)
                self.held[name] = begun("dask_worker", "--scheduler-file", self.file, "--nthreads", "1", *place)
        while not self.file.exists() or not self.file.read_text().endswith("}"):
            time.sleep(0.05)
        return json.loads(self.file.read_text())["address"]

    def down(self):
        for one in self.held.values():
            kill(one)
        self.held.clear()


def begun(what, *options):
    command = [sys.executable, "-m", f"distributed.cli.{what}", *map(str, options), "--no-dashboard"]
    return started([*command, *(["--no-nanny"] if what == "dask_worker" else [])])


def started(command):
    environment = os.environ | {"SONOSPLINE_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    nowhere = subprocess.DEVNULL
    return subprocess.Popen(command, env=environment, stdout=nowhere, stderr=nowhere, start_new_session=True)


def alive(process):
    return process is not None and process.poll() is None


def kill(process):
    if alive(process):
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def main(kills):
    chance = random.Random(0)
    text = SMALL.replace("samples = 6", f"samples = {max(40, 2 * kills)}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make_dataset(Specification.parse(text), folder / "undisturbed")
        (folder / "asked.toml").write_text(text)
        out, cluster, done = folder / "out", Cluster(folder), dict.fromkeys(VICTIMS, 0)
        verb = [sys.executable, "-m", "sonospline", "dataset", "make"]
        command = [*verb, folder / "asked.toml", "--out", out, "--quiet"]
        try:
            for _ in range(kills):
                run = started([*map(str, command), "--scheduler", cluster.up()])
                time.sleep(chance.uniform(0.2, LONGEST_S))
                victim = chance.choice(VICTIMS)
                kill(run if victim == "client" else cluster.held["worker 1" if victim == "worker" else victim])
                done[victim] += 1
                if victim == "worker":
                    cluster.up()
                    time.sleep(chance.uniform(0, 1))
                kill(run)
                if (out / "manifest.json").exists():  # complete: from the start again, but for some of it
                    for receipt in sorted(out.glob("receipts/*.json"))[::2]:
                        receipt.unlink()
                    (out / "manifest.json").unlink()
        finally:
            cluster.down()
        make_dataset(Specification.parse(text), out)
        same = DataSet(out).manifest["hash"] == DataSet(folder / "undisturbed").manifest["hash"]
        print(f"killed {', '.join(f'{count} times the {name}' for name, count in done.items())}")
        print(f"hashes {'equal' if same else 'DIFFERENT'}   found {int(not same)} that differ, at most 0")
        return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if sys.argv[1:] else 100))
