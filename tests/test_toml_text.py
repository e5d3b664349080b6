"""TOML from anywhere: read as ever, or refused in one line, and never for long."""

import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonospline.io.toml_text import MOST_DEPTH, MOST_PARTS, TomlError, loads
from sonospline.mechanics import MaterialTable

CROWDED = "a.b.c.d.e.f.g.h.i.j.k [[[[[[[[[[[[[[[[[[[[ {{{{{{{{{{{{{{{{{{{{ # "


@pytest.mark.parametrize(
    "text",
    [
        f'x = "{CROWDED}"',
        f"x = '{CROWDED}'",
        f'x = """\n{CROWDED}\n{CROWDED}"""',
        f"x = '''\n{CROWDED}'\n{CROWDED}'''''",
        f'x = """{CROWDED}"""""\ny = 1',
        f'x = "\\"{CROWDED}"\ny = "\\\\" # {CROWDED}',
        f'x = """\\"""{CROWDED}\\\\"""\ny = 1',
        f"# {CROWDED}\nx = 1 # '{CROWDED}",
        f'"{CROWDED}" = 1',
        "a.b.c.d.e.f.g.h = 1.5\n[a.b.c.d.e.f.g.i]\nj.k = 2020-01-01T00:00:00.5Z",
        "x = " + "[" * MOST_DEPTH + "]" * MOST_DEPTH,
        "[[a]]\n[[a]]\n[a.b]\nx = [[1, 2], [3]]",
        "x = 0x" + "f" * 60_000,
    ],
)
def test_what_is_toml_is_read_as_ever(text):
    assert loads(text) == tomllib.loads(text)


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_no_text_is_taken_for_keys_or_lists(text):
    quoted = json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    assert loads(f"x = {quoted}\ny = [{quoted}, {quoted}]") == {"x": text, "y": [text, text]}


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("a" + ".a" * 31_500 + " = 1", 1, f"more than {MOST_PARTS} parts"),
        ("\n[" + "a." * 31_000 + "a]", 2, f"more than {MOST_PARTS} parts"),
        ("a" + " . a" * MOST_PARTS + " = 1", 1, f"more than {MOST_PARTS} parts"),
        ('x = 1\n"a"' + ".'a'" * 15_000 + " = 1", 2, f"more than {MOST_PARTS} parts"),
        ('x = { a = """\n\n"""", ' + "b." * 30_000 + "b = 1 }", 3, f"more than {MOST_PARTS} parts"),
        ("x = " + "[" * 60_000, 1, f"more than {MOST_DEPTH} lists"),
        ("x = 1\ny = " + "{a = " * 10_000, 2, f"more than {MOST_DEPTH} lists"),
        ("x = 1" + "0" * 5000, None, "thousands of digits"),
        ("x = [", 1, "Invalid"),
        ("x = 1\nx = 2", 2, "Cannot overwrite"),
        ('"' + "k" * 60_000 + '" = {}\n[' + "k" * 60_000 + "]", 2, "Cannot declare"),
        ("x = 2020-02-31", 1, "Invalid date"),
    ],
)
def test_what_would_take_for_ever_or_die_is_one_line(text, line, says):
    with pytest.raises(TomlError, match=says) as caught:
        loads(text)
    assert caught.value.line == line
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("value", ["1" + "0" * 400, "0x" + "f" * 5000, "-1" + "0" * 400])
def test_numbers_beyond_all_bounds_are_refused_as_any_other(tmp_path, value):
    (tmp_path / "m.toml").write_text(f"[liver]\nstiffness_kpa = {value}")
    with pytest.raises(ValueError, match=r"stiffness_kpa = \(a whole number of \d+ digits\) is too large") as caught:
        MaterialTable.read(tmp_path / "m.toml")
    assert len(str(caught.value)) < 300
