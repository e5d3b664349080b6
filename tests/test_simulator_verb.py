"""``sonospline serve`` and ``bench --live``: their options, their lines, their end."""

import json
import socket
import subprocess
import sys

import pytest

from simulator_client import connect
from simulator_scenes import SMALL_PAPER
from sonospline import cli


def test_a_busy_port_is_one_clear_line(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert cli.main(["serve", "--port", str(port)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"--port = {port} on 127.0.0.1 is in use; give another one" in said


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--host", "0.0.0.0"], "give --token of at least 8 characters"),
        (
            ["--scene", "castle"],
            "--scene = 'castle' is not known; give kidney, kidney-wide, gel, cube, or a .toml file",
        ),
        (["--scene", "none.toml"], "none.toml' does not exist"),
        (["--port", "70000"], "--port = 70000 is too large"),
        (["--labels", "a.nii", "--volume", "b.mha"], "--labels and --volume were both given"),
        (["--labels", "none.nii"], "--labels = 'none.nii' does not exist"),
        (["--names", "a.csv"], "--names belongs to --labels"),
        (["--idle", "0"], "--idle = 0"),
        (["--sessions", "0"], "--sessions = 0 is too small"),
    ],
)
def test_bad_options_are_one_clear_line(options, says, capsys):
    assert cli.main(["serve", *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said


def test_the_verb_prints_its_address_and_ends_on_control_c(tmp_path):
    import signal

    (tmp_path / "small.toml").write_text(SMALL_PAPER)
    command = [sys.executable, "-m", "sonospline", "serve", "--port", "0", "--json", "--scene", "small.toml"]
    server = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    address = json.loads(server.stdout.readline())["address"]
    port = int(address.rsplit(":", 1)[1].rstrip("/"))
    with connect(f"ws://127.0.0.1:{port}/live", max_size=2**24) as page:
        assert json.loads(page.recv(timeout=60))["scenes"][0]["id"] == "small"
        server.send_signal(signal.SIGINT)
        out, err = server.communicate(timeout=30)
    assert server.returncode == 0
    assert err == ""
    assert json.loads(out)["scene"] == "small"


@pytest.mark.slow
def test_the_live_benchmark_measures_and_judges(tmp_path, capsys):
    scene = tmp_path / "small.toml"
    scene.write_text(SMALL_PAPER.replace("length_mm = 80.0", "length_mm = 120.0"))
    out = tmp_path / "bench"
    assert cli.main(["bench", "--live", "--scene", str(scene), "--seconds", "3", "--out", str(out), "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert results == json.loads((out / "live.json").read_text())
    assert results["out_of_order"] == 0
    assert results["latency"]["server_ms"]["frames"] > 5
    metrics = {claim["claim"]: claim for claim in results["claims"]}
    median = metrics["pose to encoded frame, median, ms"]
    assert median["figure"] == results["latency"]["server_ms"]["median"]
    assert median["kept"] == (median["figure"] <= 20)
    assert "| server ms |" in (out / "live.md").read_text()


def test_the_server_listens_before_readers_and_solvers_are_loaded():
    """They load beside the page: the first image waits for the slower of the two."""
    late = ["sonospline.io.volumes", "sonospline.io.headers", "sonospline.elasticity.solver", "scipy", "SimpleITK"]
    program = f"import sys, sonospline.server.server; print([m for m in {late} if m in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", program], text=True).strip() == "[]"
