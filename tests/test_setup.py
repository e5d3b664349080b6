"""``./run`` and ``./test`` on a bare machine: a folder of stubs is all that is on the path."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOOLS = (
    "bash", "cat", "chmod", "cksum", "cmp", "cp", "dirname", "env", "find", "flock", "grep", "mkdir", "mv", "paste",
    "readlink", "rm", "sed", "sleep", "sort", "tail", "touch", "tr", "xargs",
)  # fmt: skip
COPIED = (
    "run", "test", "scripts/setup.sh", "scripts/packages.sh", "pyproject.toml", "constraints.txt", "CMakeLists.txt",
    "web/package.json", "web/.npmrc", "web/vite.config.ts", "web/index.html", "web/src/main.ts",
)  # fmt: skip

pytestmark = pytest.mark.skipif(not all(map(shutil.which, TOOLS)), reason="needs the tools of a Linux system")

# Python, whose environments, packages and servers are notes in a file.
PYTHON = """#!/usr/bin/env bash
case "$*" in
*"-m venv"*)
    echo "venv ${*: -1}" >>"$CALLS"
    rm -rf .venv && mkdir -p .venv/bin .venv/lib/python3/site-packages && cp "$STUBS/python3" .venv/bin/python
    echo "command = python3 -m venv $PWD/.venv" >.venv/pyvenv.cfg ;;
*"-m pip install"*)
    echo "pip ${*: -1} $HTTPS_PROXY" >>"$CALLS"
    [ ! -e "$STUBS/pip-hook" ] || . "$STUBS/pip-hook" ;;
*"sonospline serve"*) echo "serve ${*:5} in $PWD" >>"$CALLS" ;;
*"-m pytest"*) echo "pytest ${*:3}" >>"$CALLS" ;;
*"sonospline._core"*) if command -v c++ >/dev/null; then echo core; else echo twin; fi ;;
*version_info*) [ ! -e "$STUBS/old" ] ;;
*python_version*) echo 3.9.2 ;;
*"import pip"* | *ensurepip* | *Python.h* | -V) ;;
*) exit 9 ;;
esac
"""
STUB = {
    "python3": PYTHON,
    "c++": "#!/usr/bin/env bash\n",
    "node": "#!/usr/bin/env bash\n",
    "npm": """#!/usr/bin/env bash
echo "npm $* $npm_config_cache" >>"$CALLS"
case "$*" in
*install*) mkdir build/web/node_modules ;;
*build*) mkdir build/page && echo page >build/page/index.html ;;
esac
""",
    "apt-get": """#!/usr/bin/env bash
echo "apt-get $* ${http_proxy:-}" >>"$CALLS"
[ ! -e "$STUBS/offline" ] || { echo "Temporary failure resolving 'mirror'" >&2; exit 100; }
case "$*" in
*install*) cp "$STUBS/shelf/"* "$STUBS" ;;
esac
""",
    "dpkg": "#!/usr/bin/env bash\n",
    "id": "#!/usr/bin/env bash\necho ${USER_ID:-0}\n",
    "sudo": """#!/usr/bin/env bash
case $1 in -n | -v) exit 0 ;; esac
echo "sudo" >>"$CALLS"
exec env -i PATH="$PATH" CALLS="$CALLS" STUBS="$STUBS" "$@"
""",
}


class Machine:
    """A machine with the stubs named, whose apt-get brings the others."""

    def __init__(self, folder, here):
        self.project, self.stubs, self.calls_file = folder / "a project", folder / "bin", folder / "calls"
        (self.stubs / "shelf").mkdir(parents=True)
        for tool in TOOLS:
            (self.stubs / tool).symlink_to(shutil.which(tool))
        for name, text in STUB.items():
            self.put(name if name in here else f"shelf/{name}", text)
        for name in COPIED:
            (self.project / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, self.project / name)
        for name in ("src/sonospline/_core/src/common/core.cpp", "src/sonospline/server/server.py"):
            (self.project / name).parent.mkdir(parents=True)
            (self.project / name).touch()
        self.environment = {
            "PATH": str(self.stubs), "CALLS": str(self.calls_file), "STUBS": str(self.stubs), "HOME": str(folder),
            "HTTPS_PROXY": "", "npm_config_cache": "",
        }  # fmt: skip

    def put(self, name, text=""):
        path = self.stubs / name
        path.write_text(text)
        path.chmod(0o755)

    def begin(self, *command, **environment):
        program, *options = command
        return subprocess.Popen(
            [self.stubs / "bash", self.project / program, *options], cwd=self.stubs, stdin=subprocess.DEVNULL,
            env={**self.environment, **environment}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def start(self, *command, code=0, **environment):
        """Run a command of the project from another folder; what it said."""
        process = self.begin(*command, **environment)
        out, said = process.communicate(timeout=60)
        assert process.returncode == code, said
        return said if command[-1] != "--help" else out

    def calls(self):
        """What was called since the last time this was asked."""
        lines = self.calls_file.read_text().splitlines() if self.calls_file.exists() else []
        self.calls_file.unlink(missing_ok=True)
        return lines


@pytest.fixture
def machine(tmp_path):
    """Make a machine that has the programs named."""
    return lambda *here: Machine(tmp_path, here)


WHOLE = ("python3", "c++", "node", "npm")
BARE = ("apt-get", "dpkg", "id", "sudo")
SET_UP = ["venv .venv", "pip pip", "pip .[all]", "npm --prefix build/web install", "npm --prefix web run build"]


def prefixes(calls):
    """What was called, as far as it is named in SET_UP."""
    return [next((known for known in SET_UP if call.startswith(known)), call) for call in calls]


def test_a_bare_machine_is_told_what_comes_and_why_then_served_with_the_options_given(machine):
    bare = machine(*BARE)
    said = bare.start("run", "--port", "9000", "--scene", "my block.toml")
    assert said.startswith("run: installing by apt-get: python3 python3-venv python3-dev (Python 3.11 or newer), ")
    assert "g++ (a C++17 compiler, for the core), nodejs npm (Node.js 18 or newer, for the page)\n" in said
    update, install, *rest = bare.calls()
    assert update.split() == ["apt-get", "update"]
    assert install.split()[-6:] == ["python3", "python3-venv", "python3-dev", "g++", "nodejs", "npm"]
    served = f"serve --port 9000 --scene my block.toml in {bare.stubs}"  # a path in it is the caller's
    assert prefixes(rest) == [*SET_UP, served]
    assert (bare.project / "src/sonospline/server/page/index.html").read_text() == "page\n"


def test_a_second_start_does_nothing_twice_and_a_change_what_it_needs(machine):
    whole = machine(*WHOLE)
    whole.start("run")
    assert prefixes(whole.calls())[:-1] == SET_UP
    assert whole.start("run") == ""
    assert [call.split()[0] for call in whole.calls()] == ["serve"]
    (whole.project / "web/src/main.ts").write_text("// another page")
    whole.start("run")
    assert prefixes(whole.calls())[:-1] == SET_UP[-1:]
    (whole.project / "src/sonospline/_core/src/common/core.cpp").write_text("// another core")
    whole.start("run")
    assert prefixes(whole.calls())[:-1] == SET_UP[1:3]


def test_the_tests_need_more_and_their_arguments_pass_on(machine):
    bare = machine(*BARE)
    said = bare.start("test", "quick", "--", "-k", "needle or probe")
    assert "chromium (for the tests in a browser)" in said
    wanted = "python3 python3-venv python3-dev g++ nodejs npm chromium"
    assert bare.calls_file.read_text().splitlines()[1].strip().endswith(wanted)
    assert (
        bare.calls()[-1]
        == "pytest -n 2 --dist worksteal --durations 20 --durations-min 10 -m not slow -k needle or probe"
    )
    assert "no step or option" in bare.start("test", "all", code=2)
    assert "--no-install" in bare.start("test", "--help")
    assert "--no-install" in bare.start("run", "--help")


SMALLER = "going on on the NumPy twin (the same results, slower), without the page"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("here", "options"), [(BARE, ["--no-install"]), ((), []), (("apt-get",), [])],
    ids=["--no-install", "no apt-get", "no root"],
)  # fmt: skip
def test_what_is_not_installed_is_one_line_with_the_smaller_thing(machine, here, options):
    poor = machine("python3", *here)
    poor.put("id", "#!/usr/bin/env bash\necho ${USER_ID:-1000}\n")
    said = poor.start("run", *options, "--port", "0")
    first = said.splitlines()[0]
    assert first.startswith("run: missing: g++ (a C++17 compiler, for the core), nodejs npm (")
    assert first.endswith(f"on Debian and Ubuntu, as root: apt-get install g++ nodejs npm; {SMALLER}")
    assert prefixes(poor.calls()) == [*SET_UP[:3], f"serve --port 0 in {poor.stubs}"]
    poor.put("c++", STUB["c++"])  # a compiler that comes later is used
    poor.start("run", *options)
    assert prefixes(poor.calls())[:-1] == SET_UP[1:3]


def test_without_python_nothing_works_and_an_old_one_is_named(machine):
    poor = machine("id")
    said = poor.start("run", code=1)
    assert said.count("\n") == 1
    assert "missing: python3 python3-venv python3-dev (Python 3.11 or newer)" in said
    assert "nothing works without" in said
    poor.put("python3", PYTHON)
    poor.put("old")
    said = poor.start("run", code=1, PYTHON="python3")
    assert said.startswith("run: Python 3.11 or newer is needed, 3.9.2 is here")
    assert said.count("\n") == 1
    assert poor.calls() == []


def test_all_demands_everything(machine):
    said = machine(*WHOLE).start("test", "--all", "--no-install", "quick", code=1)
    assert "missing: chromium" in said
    assert "all of it is needed here" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["http_proxy", "HTTP_PROXY"])
def test_a_proxy_goes_through_sudo_and_to_pip(machine, name):
    bare = machine(*BARE)
    bare.start("run", USER_ID="1000", HTTPS_PROXY="http://[::1]:9", **{name: "http://127.0.0.1:9"})
    calls = bare.calls()
    assert calls[0] == "sudo"
    assert [call.split()[-1] for call in calls if call.startswith("apt-get")] == ["http://127.0.0.1:9"] * 2
    assert [call.split()[-1] for call in calls if call.startswith("pip")] == ["http://[::1]:9"] * 2


def test_no_network_is_one_clear_line(machine):
    bare = machine(*BARE)
    bare.put("offline")
    said = bare.start("run", code=1).splitlines()
    assert len(said) == 2
    assert "no network" in said[1]
    assert "--no-install" not in said[1], "nothing works without Python"
    (bare.stubs / "offline").unlink()
    bare.put("pip-hook", "echo 'Failed to establish a new connection: Name or service not known'; exit 1")
    assert "no network" in bare.start("run", code=1).splitlines()[-1]
    (bare.stubs / "pip-hook").unlink()
    bare.start("run")  # the next start goes on
    assert bare.calls()[-1].startswith("serve")


@pytest.mark.slow
def test_what_an_interrupted_start_left_is_not_taken_for_whole(machine):
    whole = machine(*WHOLE)
    python = whole.project / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.touch(0o755)
    shutil.copytree(whole.project / "web", whole.project / "build/web")
    said = whole.start("run")
    assert "the one here is unfinished" in said
    assert prefixes(whole.calls())[:-1] == SET_UP
    packages = whole.project / ".venv/lib/python3/site-packages"
    (packages / "half-1.0.dist-info").mkdir()
    (packages / "whole-1.0.dist-info").mkdir()
    (packages / "whole-1.0.dist-info/RECORD").write_text("whole")
    (packages / "~umpy").mkdir()
    (whole.project / ".venv/run.stamp").unlink()
    whole.start("run")
    assert [path.name for path in packages.iterdir()] == ["whole-1.0.dist-info"]


def test_two_starts_at_once_take_turns(machine):
    whole = machine(*WHOLE)
    whole.put("pip-hook", 'touch "$STUBS/at-work"; while [ ! -e "$STUBS/go" ]; do sleep 0.02; done')
    first = whole.begin("run")
    while not (whole.stubs / "at-work").exists():
        assert first.poll() is None
    second = whole.begin("run")
    assert "another start is at work here" in second.stderr.readline()
    whole.put("go")
    for process in (first, second):
        process.communicate(timeout=60)
        assert process.returncode == 0
    assert sorted(prefixes(whole.calls())) == sorted([*SET_UP, *[f"serve  in {whole.stubs}"] * 2])


def test_npm_keeps_its_cache_beside_the_build_where_there_is_no_home(machine):
    whole = machine(*WHOLE)
    whole.start("run", HOME="/nonexistent")
    assert next(call for call in whole.calls() if call.startswith("npm")).endswith(f"{whole.project}/build/npm-cache")
    (whole.project / "web/src/main.ts").write_text("// another page")
    whole.start("run")
    assert next(call for call in whole.calls() if call.startswith("npm")).endswith("--emptyOutDir ")


@pytest.mark.skipif(shutil.which("node") is None or shutil.which("npm") is None, reason="needs Node.js")
def test_a_real_node_is_asked_for_its_version():
    ask = f'. "{ROOT}/scripts/setup.sh"; has_npm && echo new || echo old'
    version = subprocess.check_output(["node", "--version"], text=True)
    new = int(version.strip().lstrip("v").split(".")[0]) >= 18
    assert subprocess.check_output(["bash", "-c", ask], text=True).strip() == ("new" if new else "old")
