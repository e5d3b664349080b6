"""Installing without a compiler, as on a bare machine. Slow: it builds the package."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_without_a_compiler_it_installs_and_says_that_it_runs_on_the_twin(tmp_path):
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    # NumPy and SciPy of this environment, without its editable sonospline: a path file is not read twice.
    site = Path(
        subprocess.check_output([python, "-c", "import site; print(site.getsitepackages()[0])"], text=True).strip()
    )
    (site / "neighbours.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--force-reinstall", ROOT]
    no_compiler = {**os.environ, "CC": "/bin/false", "CXX": "/bin/false"}
    built = subprocess.run(pip, env=no_compiler, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    doctor = [python, "-m", "sonospline", "doctor"]
    report = json.loads(subprocess.check_output([*doctor, "--json"], cwd=tmp_path, text=True))
    assert report["backend"] == "numpy"
    assert report["self_check"]["passed"]
    assert "NumPy twin" in subprocess.check_output(doctor, cwd=tmp_path, text=True)
    assert not list(site.glob("sonospline/**/*.so"))
