"""The core on ARM, whose vectors are NEON's: built for it, run by an emulator, and compared with this machine's."""

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

CORE = Path(__file__).parent.parent / "src/sonospline/_core/src"
COMPILER, EMULATOR = shutil.which("aarch64-linux-gnu-g++"), shutil.which("qemu-aarch64-static")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (COMPILER and EMULATOR), reason="needs Debian's g++-aarch64-linux-gnu and qemu-user-static"),
]


def built(compiler, folder, *options):
    """The program of core_on_arm.cpp, from all sources of the core but those for Python."""
    folder.mkdir()
    sources = [path for path in CORE.rglob("*.cpp") if not path.name.startswith(("bindings", "faults"))]

    def compiled(source):
        name = folder / f"{source.parent.name}_{source.stem}.o"
        flags = ["-std=gnu++17", "-O2", "-fno-math-errno", "-fno-trapping-math", "-DSONO_ISA=baseline", f"-I{CORE}"]
        subprocess.run([compiler, *flags, "-c", source, "-o", name], check=True)
        return name

    with ThreadPoolExecutor(2) as pool:
        objects = list(pool.map(compiled, [*sources, Path(__file__).with_name("core_on_arm.cpp")]))
    subprocess.run([compiler, *options, *objects, "-o", folder / "program", "-lpthread"], check=True)
    return folder / "program", folder / "elasticity_elastic_kernels.o"


def said(*command):
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return {name: [float(value) for value in values] for name, *values in map(str.split, lines)}


def test_the_core_computes_on_arm_what_it_does_here_with_neons_vectors(tmp_path):
    here, _ = built("g++", tmp_path / "here")
    there, kernels = built(COMPILER, tmp_path / "there", "-static")
    ours, theirs = said(here), said(EMULATOR, there)
    assert ours.keys() == theirs.keys() == {"elastic", "load", "spline"}
    for what, (mixed, size) in theirs.items():
        assert mixed == pytest.approx(ours[what][0], abs=3e-6 * size)
        assert size == pytest.approx(ours[what][1], rel=1e-6)
    code = subprocess.run(
        ["aarch64-linux-gnu-objdump", "-d", kernels], check=True, capture_output=True, text=True
    ).stdout
    assert code.count(".4s") > 1000
