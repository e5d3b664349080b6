"""Implementations of OpenIGTLink that are not ours, for tests; each of them may be absent but in CI.

- Debian's C++ library (libopenigtlink-dev: protocol 2, header version 1), by programs built with it;
- libOpenIGTLink.so.3 of the wheel pyFAST (protocol 3), by its functions of C;
- pyigtl (header versions 1 and 2).
"""

import ctypes
import os
import shutil
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import pytest

INCLUDE, EXAMPLES = Path("/usr/include/openigtlink"), Path("/usr/share/doc/openigtlink-examples/examples")
REQUIRED = os.environ.get("SONOSPLINE_REQUIRE_OPENIGTLINK") == "1"
ECHO = Path(__file__).parent / "oracles" / "igtl_echo.cxx"


def absent(what):
    if REQUIRED:
        pytest.fail(f"{what} is not installed, and SONOSPLINE_REQUIRE_OPENIGTLINK is set")
    pytest.skip(f"{what} is not installed")


def built(source, folder):
    """A program of Debian's library, from its source."""
    compiler = shutil.which("g++")
    if not INCLUDE.exists() or compiler is None:
        absent("libopenigtlink-dev")
    program = folder / Path(source).stem
    if not program.exists():
        subprocess.run(
            [compiler, f"-I{INCLUDE}", str(source), "-o", str(program), "-lOpenIGTLink"], check=True, timeout=300
        )
    return program


def example(name, folder):
    """One of the library's example programs, ``Tracker/TrackerClient``."""
    source = EXAMPLES / f"{name}.cxx"
    if not source.exists():
        absent("openigtlink-examples")
    return built(source, folder)


@cache
def library_of_protocol_3():
    try:
        [path] = [file.locate() for file in files("pyFAST") or () if file.name == "libOpenIGTLink.so.3"]
    except (PackageNotFoundError, ValueError):
        return None
    library = ctypes.CDLL(str(path))
    library.crc64.restype = ctypes.c_uint64
    library.crc64.argtypes = (ctypes.c_char_p, ctypes.c_uint64, ctypes.c_uint64)
    return library
