"""A cluster makes the same data set as one process, whoever comes late, dies, is killed, or is of another kind."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest

from builds import needs_core
from small_datasets import SMALL, small
from sonospline.dataset import DataSet, make_dataset
from sonospline.dataset.cluster import _check_scheduler, cluster, made_by_workers, made_on
from sonospline.dataset.provenance import provenance
from sonospline.dataset.shard import Receipt, WorkerError, check_worker

pytest.importorskip("distributed", reason="needs the extra 'data'")
pytest.importorskip("zarr", reason="needs the extra 'data'")

KILLS = int(os.environ.get("SONOSPLINE_KILLS", "2"))
"""How often a run is killed."""
MOST_S = 600
ENOUGH = SMALL.replace("samples = 6", "samples = 16")


def client_with(ours, theirs):
    """A client of a cluster whose workers say so of themselves."""
    return SimpleNamespace(wait_for_workers=lambda *_, **__: None, run=lambda *_, **__: theirs, ours=ours)


@pytest.mark.parametrize(
    ("worker", "said"),
    [
        pytest.param(
            {"backend": "numpy", "instruction_set": "numpy"},
            "the workers run without the compiled core",
            marks=needs_core,
        ),
        ({"numpy": "1.0"}, "worker tcp://b would make other bits: its numpy is 1.0 instead of"),
        ({"code": "other"}, "its code is other instead of"),
        (ModuleNotFoundError("No module named 'sonospline'"), "cannot run sonospline .*install the same version"),
    ],
)
def test_workers_of_another_kind_are_refused(worker, said):
    theirs = worker if isinstance(worker, Exception) else provenance() | worker
    with pytest.raises(WorkerError, match=said) as refused:
        made_on(client_with(None, {"tcp://b": theirs}))
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_processes_of_this_machine_compute_with_one_thread_and_look_after_themselves_seldom():
    config = pytest.importorskip("dask").config
    before = config.get("distributed.admin.tick.interval")
    with cluster(1, None, lambda text: None) as client:
        look = "distributed.worker.profile.enabled", "distributed.admin.tick.interval"
        names = "ZARR_THREADING__MAX_WORKERS", "MALLOC_TRIM_THRESHOLD_"
        (found,) = client.run(lambda: (*map(config.get, look), *map(os.environ.get, names))).values()
    assert found == (False, "500ms", "1", os.environ.get("MALLOC_TRIM_THRESHOLD_"))
    assert config.get("distributed.admin.tick.interval") == before


def test_one_worker_of_another_instruction_set_is_refused():
    found = {"tcp://a": provenance(), "tcp://b": provenance() | {"instruction_set": "neon"}}
    with pytest.raises(WorkerError, match="worker tcp://b would make other bits: its instruction_set is neon"):
        made_on(client_with(None, found))
    with pytest.raises(WorkerError, match="a worker would make other bits"):
        check_worker(provenance() | {"instruction_set": "neon"})


def test_a_scheduler_of_another_version_is_refused():
    versions = {"client": {"packages": {"distributed": "2"}}, "scheduler": {"packages": {"distributed": "1"}}}
    client = SimpleNamespace(get_versions=lambda check: versions)
    with pytest.raises(RuntimeError, match="has distributed 1 and this machine 2; install the same on both"):
        _check_scheduler(client, "tcp://a")


def test_nobody_at_the_address(tmp_path, monkeypatch):
    monkeypatch.setattr("sonospline.dataset.cluster.ANSWER_S", 0.1)
    with pytest.raises(ValueError, match=r"scheduler = 'tcp://127.0.0.1:1' does not answer.*give a running"):
        make_dataset(small(), tmp_path / "out", scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def threaded(tmp_path_factory):
    """What one process with two threads makes."""
    from distributed import Client, LocalCluster

    folder = tmp_path_factory.mktemp("threaded")
    with (
        LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as local,
        Client(local, set_as_default=False) as client,
    ):
        make_dataset(small(samples=16), folder, client=client)
    return DataSet(folder).manifest["hash"]


def nothing_made(job, shard):
    return Receipt(shard=shard, first=shard, samples=1, files={}, failed={})


@pytest.mark.slow
def test_a_client_holds_no_more_however_much_there_is_to_do(monkeypatch):
    """So many shards as 100,000 samples have: no more futures at a time than workers can begin."""
    from distributed import Client, LocalCluster

    monkeypatch.setattr("sonospline.dataset.cluster.make_shard", nothing_made)
    with (
        LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as local,
        Client(local, set_as_default=False) as client,
    ):
        held = [(receipt.shard, len(client.futures)) for receipt in made_by_workers(client, None, list(range(400)))]
    assert sorted(shard for shard, _ in held) == list(range(400))
    assert max(count for _, count in held) <= 2 * 2 + 2


@contextmanager
def process(*command, **settings):
    """A process of its own group, which is gone in the end."""
    environment = os.environ | {"SONOSPLINE_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    held = subprocess.Popen(
        [sys.executable, *command], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True, **settings,
    )  # fmt: skip
    try:
        yield held
    finally:
        with suppress(ProcessLookupError):
            os.killpg(held.pid, signal.SIGKILL)
        held.wait()
        held.stderr.close()


def until(condition):
    """Wait for something that other processes do."""
    end = time.monotonic() + MOST_S
    while not condition():
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.05)


def make_command(specification, out, *more):
    return ("-m", "sonospline", "dataset", "make", str(specification), "--out", str(out), "--quiet", *more)


@pytest.mark.slow
def test_a_run_that_is_killed_again_and_again_ends_as_one_that_was_not(threaded, tmp_path):
    (tmp_path / "asked.toml").write_text(ENOUGH)
    out, chance = tmp_path / "out", random.Random(1)
    for kill in range(KILLS):
        workers = ("--workers", "2") if kill % 2 else ()
        with process(*make_command(tmp_path / "asked.toml", out, *workers)) as run:
            there = len(list(out.glob("receipts/*.json")))
            until(lambda: len(list(out.glob("receipts/*.json"))) > there or run.poll() is not None)  # noqa: B023
            time.sleep(chance.uniform(0, 0.2))  # anywhere in a shard
    with process(*make_command(tmp_path / "asked.toml", out)) as run:
        assert run.wait(MOST_S) == 0, run.stderr.read()
    assert DataSet(out).manifest["hash"] == threaded
    assert not list(out.rglob(".partial-*"))


@pytest.mark.slow
def test_a_real_cluster_with_one_worker_late_and_one_dead(threaded, tmp_path):
    (tmp_path / "asked.toml").write_text(ENOUGH)
    out, file = tmp_path / "out", tmp_path / "scheduler.json"
    worker = ("-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard")
    quiet = ("--no-nanny", "--local-directory", str(tmp_path))
    scheduler = ("-m", "distributed.cli.dask_scheduler", "--scheduler-file", str(file), "--port", "0", "--no-dashboard")
    with process(*scheduler):
        until(file.exists)
        until(lambda: file.read_text().endswith("}"))
        address = json.loads(file.read_text())["address"]
        with (
            process(*worker, *quiet) as first,
            process(*make_command(tmp_path / "asked.toml", out, "--scheduler", address)) as run,
        ):
            until(lambda: list(out.glob("receipts/*.json")) or run.poll() is not None)
            with process(*worker, *quiet):  # comes late
                os.kill(first.pid, signal.SIGKILL)
                assert run.wait(MOST_S) == 0, run.stderr.read()
    assert DataSet(out).manifest["hash"] == threaded


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_said_in_one_line(tmp_path):
    (tmp_path / "asked.toml").write_text(SMALL.replace("samples = 6", "samples = 100_000"))
    out, file = tmp_path / "out", tmp_path / "scheduler.json"
    scheduler = ("-m", "distributed.cli.dask_scheduler", "--scheduler-file", str(file), "--port", "0", "--no-dashboard")
    worker = ("-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard")
    with process(*scheduler) as head:
        until(file.exists)
        until(lambda: file.read_text().endswith("}"))
        address = json.loads(file.read_text())["address"]
        with (
            process(*worker, "--no-nanny", "--local-directory", str(tmp_path)),
            process(*make_command(tmp_path / "asked.toml", out, "--scheduler", address)) as run,
        ):
            until(lambda: list(out.glob("receipts/*.json")) or run.poll() is not None)
            os.kill(head.pid, signal.SIGKILL)
            assert run.wait(MOST_S) == 1
            said = [line for line in run.stderr.read().splitlines() if line.startswith("sonospline")]
    assert len(said) == 1
    assert "the scheduler went away" in said[0]
    assert not (out / "manifest.json").exists()
