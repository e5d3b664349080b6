"""The house: what may import what, how large a room and a file may be, and which words are not used."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "sonospline"
PAGE = ROOT / "web" / "src"

FLOORS = (
    {"base"},
    {"_core"},
    {"geometry"},
    {"io"},
    {"fields"},
    {"mechanics"},
    {"elasticity"},
    {"contact"},
    {"models"},
    {"fem", "ultrasound"},
    {"phantoms"},
    {"simulator", "igtl"},
    {"training", "tracking", "dataset"},
    {"lab", "envs"},
    {"link"},
    {"server"},
    {"course"},
    {"bench"},
    {"study"},
    {"commands"},
    {"cli"},
)
"""From left to right: a room imports from floors before its own only."""
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}

REFERENCE_USERS = {"study", "commands"}
"""Rooms that compare models with reference solutions; production is all the others."""
TWIN_USERS = {"sonospline._core", "sonospline.commands.doctor", "sonospline._core._native"}
"""The stub of the compiled core says that its functions are the twin's."""

LARGEST_ROOM, LARGEST_FILE = 4000, 400
SUFFIXES = {".py", ".pyi", ".cpp", ".hpp", ".ts", ".css"}
GENERATED = {"_native.pyi"}

UNUSED_WORDS = re.compile(
    r"(?<![a-z])(wish(es)?|told|shots?|granted|complain(s|t|ts|ed)?|deaf|rhythms?|tidying|figures|folding|_later|_fields)"
    r"(?![a-z])"
)
"""Words of no field that this one builds on; a picture in a paper is a figure, so that comments may say it."""
LIBRARY = re.compile(r"(?<![a-z])librar(y|ies)(?![a-z])")


@cache
def modules():
    """Name of every module of the package, stubs as their modules, with its files."""
    found = defaultdict(list)
    for file in sorted(PACKAGE.rglob("*.py*")):
        if file.suffix in (".py", ".pyi"):
            parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)].append(file)
    return dict(found)


def room_of(module):
    """First folder below the package; what lies in none is the base, but for the face and the command line."""
    parts = module.split(".")[1:]
    if not parts or parts[0] in ("cli", "__main__"):
        return "cli"
    return parts[0] if len(parts) > 1 or (PACKAGE / parts[0]).is_dir() else "base"


def imports_of(module, files):
    """Every module of the package that a module imports, anywhere in it; a name that is a module is that module."""
    for file in files:
        package = module.split(".") if file.stem == "__init__" else module.split(".")[:-1]
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                above = package[: len(package) - node.level + 1] if node.level else []
                base = ".".join([*above, *([node.module] if node.module else [])])
                names = [f"{base}.{alias.name}" for alias in node.names]
                names = [name if name in modules() else base for name in names]
            else:
                continue
            yield from (name for name in names if name in modules() and name != module)


@cache
def graph():
    return {module: set(imports_of(module, files)) for module, files in modules().items()}


def is_face(module):
    """Whether a module only hands on the names of its package."""
    return any(file.stem == "__init__" for file in modules()[module])


def test_every_room_has_its_floor():
    assert {room_of(module) for module in modules()} == set(FLOOR)


def test_the_table_of_rooms_has_them_all():
    rows = re.findall(r"^\| (.*?) \|", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert set(FLOOR) <= {room for row in rows for room in re.findall(r"\w+", row)}


def test_nothing_imports_what_it_feeds():
    back = [
        f"{module} imports {imported}"
        for module, names in graph().items()
        for imported in sorted(names)
        if module != "sonospline" and imported != "sonospline"
        if room_of(imported) != room_of(module) and FLOOR[room_of(imported)] >= FLOOR[room_of(module)]
    ]
    assert back == []


def test_no_circle():
    """A package's own names are what its modules are, so that a module that imports its package makes one, too."""
    done, circles = set(), []

    def visit(module, way):
        if module in way:
            circles.append(" -> ".join([*way[way.index(module) :], module]))
        elif module not in done:
            for imported in sorted(graph()[module]):
                visit(imported, [*way, module])
            done.add(module)

    for module in graph():
        visit(module, [])
    assert circles == []


def test_production_knows_no_reference_solution():
    rooms = {room_of(module) for module, names in graph().items() for name in names if room_of(name) == "fem"}
    assert rooms == {"fem", *REFERENCE_USERS}


def test_only_the_choice_of_backend_and_the_doctor_know_the_twin():
    twins = {module for module in modules() if module.startswith("sonospline._core.twin")}
    users = {module for module, names in graph().items() if names & twins and module not in twins}
    by_name = {
        module
        for module, files in modules().items()
        if any(re.search(r"_core\.twin", file.read_text()) for file in files)
    }
    assert users | by_name == TWIN_USERS


def lines(file):
    return len(file.read_text().splitlines())


def test_no_room_is_too_large():
    sizes = defaultdict(int)
    for module, files in modules().items():
        sizes[room_of(module)] += sum(map(lines, files))
    assert {room: size for room, size in sizes.items() if size >= LARGEST_ROOM and room != "_core"} == {}


@cache
def sources():
    """Files that people write, of every dialect."""
    folders = [ROOT / name for name in ("src", "tests", "benchmarks", "examples", "docs", "scripts")] + [PAGE]
    return [
        file
        for folder in folders
        for file in sorted(folder.rglob("*"))
        if file.suffix in SUFFIXES and file.name not in GENERATED and ".gen." not in file.name
        if not {"page", "_build"} & set(file.relative_to(ROOT).parts)  # what is built is not written
    ]


def test_no_file_is_too_long():
    assert {str(file.relative_to(ROOT)): lines(file) for file in sources() if lines(file) > LARGEST_FILE} == {}


def spoken(file):
    """Names of all kinds in a file, as words parted by blanks, and its comments."""
    if file.suffix not in (".py", ".pyi"):
        text = file.read_text()
        yield from (line for line in text.splitlines() if "http" not in line)
        return
    yield file.stem
    for token in tokenize.generate_tokens(io.StringIO(file.read_text()).readline):
        if token.type in (tokenize.NAME, tokenize.COMMENT):
            yield token.string


def parted(name):
    """``CamelCase`` and ``snake_case`` as lower-case words, with the underscore of each."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def may_say(file, words):
    """Whether words occur anywhere in a file; which tokens say them takes longer to find out."""
    return words.search(parted(f"{file.stem} {file.read_text()}"))


def test_names_and_comments_use_the_words_of_the_field():
    found = {
        f"{file.relative_to(ROOT)}: {text.strip()}"
        for file in sources()
        if (file.is_relative_to(PACKAGE) or file.is_relative_to(PAGE)) and may_say(file, UNUSED_WORDS)
        for text in spoken(file)
        if UNUSED_WORDS.search(parted(text))
    }
    assert found == set()


def test_no_name_is_a_library():
    """What is kept by name is a catalog, a table or a registry; a library is what somebody else wrote."""
    found = {
        f"{file.relative_to(ROOT)}: {token.string}"
        for file in sources()
        if file.is_relative_to(PACKAGE) and file.suffix in (".py", ".pyi") and may_say(file, LIBRARY)
        for token in tokenize.generate_tokens(io.StringIO(file.read_text()).readline)
        if token.type == tokenize.NAME and LIBRARY.search(parted(token.string))
    }
    assert found == set()
