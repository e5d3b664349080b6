"""Type hints tell the truth: mypy accepts how users call the package, in examples, pages and a file of calls."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
READERS_OWN = "".join(f"{name}: Any\n" for name in ("draw", "record", "show", "warn", "page_is_ready"))
BY_THE_READER = {"simulator.md": f"from typing import Any\n{READERS_OWN}"}
"""Names that the text around a program leaves to its reader."""


def checked(*files, strict=False):
    """What mypy has to say of files, with its memory of the package."""
    pytest.importorskip("mypy", reason="needs the group 'lint'")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "--no-error-summary"]
    loose = [] if strict else ["--allow-untyped-defs", "--allow-untyped-calls", "--allow-any-generics"]
    done = subprocess.run(
        [*command, *loose, *map(str, files)], cwd=ROOT, capture_output=True, text=True, check=False, timeout=600
    )
    return done.stdout + done.stderr


def programs(folder):
    """The programs of each page as one file."""
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        blocks = BLOCK.findall(page.read_text())
        if blocks:
            file = folder / f"{page.stem.lower()}_programs.py"
            file.write_text("\n".join([BY_THE_READER.get(page.name, ""), *blocks]))
            yield file


@pytest.mark.slow
def test_calls_of_users_are_typed():
    assert checked(ROOT / "tests" / "typing" / "public_api.py", strict=True) == ""


@pytest.mark.slow
def test_examples_and_programs_of_the_pages_are_typed(tmp_path):
    assert checked(*sorted((ROOT / "examples").glob("*.py")), *programs(tmp_path)) == ""
