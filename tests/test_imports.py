"""What is imported when: a page is served, and a verb runs, before what they do not need is loaded."""

import subprocess
import sys

import pytest

import sonospline as ss
from sonospline import simulator


def loaded_by(code):
    """Modules that a fresh interpreter holds after some code."""
    program = f"{code}\nimport sys\nprint(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.split()
    )


@pytest.mark.parametrize("package", [ss, simulator], ids=lambda package: package.__name__)
def test_every_public_name_is_there(package):
    assert all(getattr(package, name) is not None for name in package.__all__)
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match="attribute Nonsense"):
        package.Nonsense  # noqa: B018


def test_the_package_itself_loads_nothing():
    assert not {"numpy", "scipy", "sonospline.fields.field"} & loaded_by("import sonospline")


def test_the_server_listens_before_solvers_are_loaded():
    pytest.importorskip("uvicorn")
    loaded = loaded_by("import sonospline.server.server")
    assert "sonospline.server.connection" in loaded
    late = {"scipy", "sonospline.elasticity.solver", "sonospline.models.elastic.model"}
    assert not loaded & {*late, "sonospline.ultrasound.synthesis", "sonospline.simulator.scene"}


def test_a_verb_loads_none_of_the_others():
    code = "from sonospline import cli\ntry: cli.main(['serve', '--help'])\nexcept SystemExit: pass"
    loaded = {name for name in loaded_by(code) if name.startswith("sonospline.commands.")}
    assert loaded == {"sonospline.commands.serve"}
