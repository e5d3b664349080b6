"""A model that another package brings appears wherever models are chosen; one that fails hurts no other."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simulator_scenes import SMALL
from sonospline.models import Option

PAGE = Path(__file__).parents[1] / "docs" / "own_model.md"


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)


def install(folder, package, module, entry_points):
    """Lay a package into a folder as an installer would."""
    (folder / f"{package}.py").write_text(module)
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package.replace('_', '-')}\nVersion: 1.0\n")
    lines = "".join(f"{name} = {place}\n" for name, place in entry_points.items())
    (info / "entry_points.txt").write_text(f"[sonospline.models]\n{lines}")


@pytest.fixture(scope="module")
def with_toy(tmp_path_factory):
    """A folder with the page's package in it."""
    (module,), (table,) = blocks("python"), blocks("toml")
    header, entry = table.strip().splitlines()
    assert header == '[project.entry-points."sonospline.models"]'
    name, place = re.fullmatch(r'(\w+) = "(.+)"', entry).groups()
    folder = tmp_path_factory.mktemp("site")
    install(folder, "toy_tissue", module, {name: place})
    return folder


def python(folder, *arguments):
    path = os.pathsep.join([str(folder), str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True, text=True, check=False, timeout=120, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip


def printed_by(folder, program):
    """What a program prints as JSON, in a process that has the folder's packages."""
    done = python(folder, "-c", f"import json\n{program}\nprint(json.dumps(answer))")
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_the_page_shows_a_model_of_about_thirty_lines():
    (module,) = blocks("python")
    code = [line for line in module.splitlines() if line.strip()]
    assert len(code) < 45


def test_insert_offers_it_and_runs_it(with_toy, tmp_path):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    text = python(with_toy, "-m", "sonospline", "insert", "--help").stdout
    assert "{paper,kelvinlet,elastic,toy}" in text and "--reach-mm MM" in text
    small = ("--nodes", "2000", "--steps", "2", "--quiet", "--json", "--out", tmp_path / "out")
    done = python(with_toy, "-m", "sonospline", "insert", "--model", "toy", "--reach-mm", "20", *small)
    assert (done.returncode, done.stderr) == (0, "")
    summary = json.loads(done.stdout)
    assert summary["model"] == "toy"
    assert 1.0 < summary["max_displacement_mm"] <= 2.0
    done = python(with_toy, "-m", "sonospline", "insert", "--model", "toy", "--reach-mm", "500", *small)
    assert done.returncode == 2
    assert "--reach-mm = 500 is out of range; give a number from 1 to 100 mm" in done.stderr
    done = python(with_toy, "-m", "sonospline", "insert", "--reach-mm", "5", *small)
    assert "--reach-mm belongs to --model toy, not to --model paper; leave one out" in done.stderr


def test_a_session_runs_it_and_the_page_lists_it(with_toy):
    found = printed_by(
        with_toy,
        f"""
import sonospline as ss
from sonospline.simulator import Console, SceneFile, Session, scene_schema
from sonospline.server.server_messages import SceneMessage
scene = SceneFile.parse({SMALL!r}.replace("[model]", '[model]\\nuse = "toy"\\nreach_mm = 12'))
session = Session(scene)
face = session.scene.tissue.grid.extent / 2
entry = session.scene.tissue.grid.world([face[0], face[1], 0.0])
needle = ss.Needle(entry, entry + [0, 0, 20.0])
frame = session.step(needles={{"needle": needle}})
console = Console(Session(scene, model="paper"))
message = SceneMessage.of("mine", console, console.command, session.scene.start, frozenset())
part = scene_schema()["$defs"]["ModelPart"]["properties"]
answer = {{
    "model": session.model, "moved": float(abs(frame.field.on_grid()).max()),
    "page": [[choice.id, choice.name] for choice in message.models],
    "use": part["use"]["enum"], "reach": part["reach_mm"]["default"],
}}
""",
    )
    assert found["model"] == "toy"
    assert 1.0 < found["moved"] <= 2.0
    assert found["page"][-1] == ["toy", "Toy"] and len(found["page"]) == 4
    assert found["use"] == ["elastic", "kelvinlet", "paper", "toy"]
    assert found["reach"] == 15.0


@pytest.mark.slow
def test_the_studys_tables_have_a_column_of_it(with_toy):
    found = printed_by(
        with_toy,
        """
import sonospline as ss
from sonospline.study.insertions import held_out_insertions
from sonospline.study.models_compared import Scope, compare_friction
from sonospline.study.report_models import _by_specimen
from sonospline.study.specimens import cube
scope = Scope(("H2",), fine=17, side=9, depths=1, steps=4, cubes=("homogeneous",))
rows = compare_friction(scope, cube("homogeneous", 9), held_out_insertions()[1], ss.NeedleTissueModel.tuned())["rows"]
answer = {"models": [row["model"] for row in rows], "table": _by_specimen(rows)}
""",
    )
    assert "toy" in found["models"]
    header = found["table"].splitlines()[0]
    assert [cell.strip() for cell in header.strip("|").split("|")] == [
        "tissue", "paper, Table I", "paper, tuned on F", "kelvinlet", "toy", "elastic"
    ]  # fmt: skip


def test_it_keeps_the_contract(with_toy):
    """Several needles add up, states compare by value, and what it cannot do it says."""
    found = printed_by(
        with_toy,
        """
import numpy as np
import sonospline as ss
from sonospline import models
tissue = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5))
model, other = models.make("toy", tissue), models.make("toy", tissue, reach_mm=20)
one, two = ss.Needle((0, 40, 50), (50, 40, 50)), ss.Needle((0, 70, 50), (40, 70, 50))
both = model.step(model.rest, {"b": two, "a": one})
alone = [model.step(model.rest, {"a": needle}).field.on_grid() for needle in (one, two)]
said = []
make = lambda: models.make("toy", tissue, needs=["time"])
for act in (lambda: other.step(both.state), lambda: both.forces["a"], make):
    try:
        act()
    except ValueError as error:
        said.append(str(error))
answer = {
    "sum": bool(np.allclose(both.field.on_grid(), sum(alone), atol=1e-6)),
    "same": model.step(model.rest, [("a", one), ("b", two)]).state == both.state, "said": said,
}
""",
    )
    assert found["sum"] and found["same"]
    state, force, time = found["said"]
    assert "with another box or other options, not of this model 'toy'" in state
    assert force == "model = 'toy' cannot do forces; use model = 'elastic'"
    assert time == "model = 'toy' cannot do time; use model = 'elastic'"


BROKEN = {
    "raises_on_import": (
        "raise RuntimeError('no licence found\\nsecond line')",
        "SPEC",
        "RuntimeError: no licence found",
    ),
    "exits_on_import": ("raise SystemExit(3)", "SPEC", "SystemExit: 3"),
    "offers_nonsense": ("SPEC = 42", "SPEC", "spec = 42 is not a ModelSpec"),
    "lacks_what_it_names": ("", "SPEC", "AttributeError"),
    "takes_a_name": (
        "from sonospline.models import ModelSpec\nSPEC = ModelSpec(name='paper', title='', summary='', maker=print)",
        "SPEC",
        "name = 'paper' is taken by another model",
    ),
}


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"name": "use"}, "name = 'use' means something else where options are given; choose another"),
        ({"name": "two words"}, "name = 'two words' is not a word"),
        ({"name": "reach", "kind": "colour"}, "kind = 'colour' is not known; choose one of number, whole, choice"),
        ({"name": "reach", "low": 1, "default": 0.0}, "default of reach = 0 is out of range; give a number from 1"),
        ({"name": "law", "kind": "choice", "choices": ("a", "b"), "default": "c"}, "default of law = 'c' is not known"),
    ],
)
def test_an_option_that_makes_no_sense_is_refused(option, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Option(help="", **option)


def test_a_plug_in_that_fails_is_one_line_and_the_others_work(with_toy, tmp_path):
    for package, (module, attribute, _) in BROKEN.items():
        install(tmp_path, package, module, {package: f"{package}:{attribute}"})
    both = os.pathsep.join([str(tmp_path), str(with_toy)])
    done = python(both, "-c", "from sonospline import models; print(models.names())")
    assert done.returncode == 0
    assert done.stdout == "('paper', 'kelvinlet', 'elastic', 'toy')\n"
    lines = done.stderr.splitlines()
    assert len(lines) == len(BROKEN)
    for line, (package, (_, _, problem)) in zip(lines, sorted(BROKEN.items()), strict=True):
        assert f"model {package!r} of {package}:SPEC is left out (" in line and problem in line
    done = python(both, "-m", "sonospline", "insert", "--help")
    assert done.returncode == 0 and "{paper,kelvinlet,elastic,toy}" in done.stdout
