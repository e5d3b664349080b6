"""Data sets: a sample depends on its number alone, what is there is whole, and what is said of it is true."""

import hashlib
import json
import pickle
import shutil
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from small_datasets import SMALL, small
from sonospline import cli
from sonospline.dataset import DataSet, Plan, Recipe, Specification, World, make_dataset, torch_samples
from sonospline.dataset.checking import Checked, check
from sonospline.dataset.draws import Stream, even, stream
from sonospline.dataset.image_truth import displacement_now, labels_now, needle_pixels
from sonospline.dataset.rebuilding import rebuild
from sonospline.dataset.recipe import UnplaceableError
from sonospline.dataset.shard import WorkerError
from sonospline.dataset.specification import specification_schema
from sonospline.dataset.store import PARTIAL, Folder, StoreError, store_at
from sonospline.dataset.table_statistics import statistics
from sonospline.geometry import ImagePlane, Volume

pytest.importorskip("zarr", reason="needs the extra 'data'")
pytest.importorskip("pyarrow", reason="needs the extra 'data'")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    make_dataset(small(), folder)
    return DataSet(folder)


def digest(sample):
    parts = [f"{name}{array.dtype}".encode() + array.tobytes() for name, array in sorted(sample.arrays.items())]
    return hashlib.sha256(b"".join(parts) + json.dumps(sample.row).encode()).hexdigest()


def test_a_sample_depends_on_its_number_alone(made):
    """Alone, after others, or backwards through a plan that was pickled: a world keeps nothing of a sample."""
    import pickle

    plan = Plan(small())
    world = World(plan.anatomy(0), plan.labels())
    forward = [digest(world.sample(plan.recipe(k))) for k in range(4)]
    again = pickle.loads(pickle.dumps(plan))
    backward = [digest(world.sample(again.recipe(k))) for k in reversed(range(4))]
    alone = World(again.anatomy(0), plan.labels()).sample(again.recipe(2))
    assert forward == backward[::-1]
    assert digest(alone) == forward[2]
    assert np.array_equal(made.shard(1)["image"][0], alone.arrays["image"])


def test_a_model_without_forces_has_none_in_the_table():
    plan = Plan(small(use='"kelvinlet"'))
    sample = World(plan.anatomy(0), plan.labels()).sample(plan.recipe(0))
    assert sample.row["force_axial_n"] is None
    assert sample.arrays["displacement"].any()


def test_tissue_that_moves_too_far_is_no_sample(monkeypatch):
    """A scanner that had to be aimed farther would show the next sample with other bits."""
    monkeypatch.setattr("sonospline.dataset.sample._MARGINS_MM", (0.1,))
    plan = Plan(small())
    with pytest.raises(RuntimeError, match=r"the tissue moves by .* mm, farther than 0.1"):
        World(plan.anatomy(0), plan.labels()).sample(plan.recipe(0))


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_is_missing_is_made_again(made, tmp_path):
    shutil.copytree(made.store.path, tmp_path, dirs_exist_ok=True)
    for gone in ("receipts/000001.json", "arrays/image/c/2/0/0"):
        (tmp_path / gone).unlink()
    (tmp_path / "arrays" / f"{PARTIAL}half").write_bytes(b"half")
    report = make_dataset(small(), tmp_path)
    assert report.made == 4
    assert not list(tmp_path.rglob(f"{PARTIAL}*"))
    files = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    other = {
        path.relative_to(made.store.path): path.read_bytes() for path in made.store.path.rglob("*") if path.is_file()
    }
    assert files == other


def test_a_sample_that_fails_is_listed_and_stops_no_other(made, tmp_path, monkeypatch):
    sample = World.sample
    monkeypatch.setattr(
        World, "sample", lambda self, recipe, split="": sample(self, recipe, split) if recipe.index != 3 else 1 / 0
    )
    report = make_dataset(small(), tmp_path)
    data = DataSet(tmp_path)
    assert report.failed == data.failed == {3: "ZeroDivisionError: division by zero"}
    assert [row["index"] for row in data.rows()] == [0, 1, 2, 4, 5]
    assert data.shard(1)["image"][0].any()
    assert not data.shard(1)["image"][1].any()
    with pytest.raises(ValueError, match="index = 3 is a sample that could not be made"):
        data.sample(3)
    monkeypatch.undo()  # what is no sample's own fault is tried again
    assert make_dataset(small(), tmp_path).failed == {}
    assert DataSet(tmp_path).manifest["hash"] == made.manifest["hash"]


def test_a_fault_of_the_machine_is_no_sample_s(tmp_path, monkeypatch):
    def away(*_):
        raise OSError(116, "Stale file handle")

    monkeypatch.setattr(World, "sample", away)
    with pytest.raises(OSError, match="Stale file handle"):
        make_dataset(small(), tmp_path)
    assert not list(tmp_path.glob("receipts/*"))


@pytest.mark.slow
def test_a_sample_that_could_not_be_drawn_stays_so(tmp_path, monkeypatch):
    recipe = Plan.recipe

    def drawn(self, index):
        if index == 3:
            raise UnplaceableError("no needle fits")
        return recipe(self, index)

    monkeypatch.setattr(Plan, "recipe", drawn)
    make_dataset(small("recipe"), tmp_path / "recipes")
    monkeypatch.undo()
    assert rebuild(DataSet(tmp_path / "recipes"), tmp_path / "again").failed == {3: "no needle fits"}


@pytest.mark.parametrize(
    ("entry", "value", "error", "said"),
    [
        ("made_by", {"numpy": "1.0"}, WorkerError, "samples would come out otherwise than the recipes': numpy is"),
        ("sources", "other", ValueError, "are of other label maps or scenes; bring those back"),
    ],
)
def test_recipes_of_other_makers_or_sources_are_refused(entry, value, error, said, tmp_path):
    make_dataset(small("recipe"), tmp_path / "recipes")
    plan = tmp_path / "recipes/plan.json"
    plan.write_text(json.dumps(json.loads(plan.read_text()) | {entry: value}))
    with pytest.raises(error, match=said):
        make_dataset(small(), tmp_path / "again", recipes=DataSet(tmp_path / "recipes").store)
    assert not (tmp_path / "again").exists()


def test_a_fault_of_every_sample_ends_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(World, "sample", lambda *_: 1 / 0)
    with pytest.raises(RuntimeError, match="none of 6 samples could be made: ZeroDivisionError"):
        make_dataset(small(), tmp_path)
    assert not (tmp_path / "manifest.json").exists()


def test_recipes_make_the_same_samples_again(made, tmp_path):
    recipes = tmp_path / "recipes"
    make_dataset(small("recipe"), recipes)
    held = DataSet(recipes)
    assert all(len(row["recipe"]) < 1000 for row in held.rows())
    rebuild(held, tmp_path / "again")
    assert DataSet(tmp_path / "again").manifest["hash"] == made.manifest["hash"]


def test_tar_files_and_any_address_hold_the_same(made):
    make_dataset(small("webdataset"), "memory://tars")
    tars = DataSet("memory://tars")
    for k in range(len(made)):
        ours, theirs = made.sample(k), tars.sample(k)
        assert ours.keys() == theirs.keys()
        assert ours["row"] == theirs["row"]
        assert all(np.array_equal(ours[name], theirs[name], equal_nan=True) for name in made.forms)


def test_every_sample_of_a_split_comes_once(made):
    found = Counter(
        int(sample["index"])
        for split in ("train", "validation", "test")
        for part in range(2)
        for sample in made.samples(split, ["needle"], shuffle=1, part=part, parts=2)
    )
    assert found == Counter(range(6))
    split = {row["anatomy"]: row["split"] for row in made.rows()}
    assert all(row["split"] == split[row["anatomy"]] for row in made.rows())


def test_batches_are_the_samples_in_their_order(made):
    alone = list(made.samples(None, ["image", "displacement"], shuffle=3))
    batches = list(made.batches(2, None, ["image", "displacement"], shuffle=3))
    assert [len(batch["index"]) for batch in batches] == [2, 2, 2]
    for name in ("index", "image", "displacement"):
        assert np.array_equal(np.concatenate([batch[name] for batch in batches]), [one[name] for one in alone])
    with pytest.raises(ValueError, match="size = 0"):
        next(made.batches(0))


def test_pytorch_reads_every_pass_in_an_order_of_its_own(made):
    torch = pytest.importorskip("torch", reason="needs the extra 'torch'")
    orders = []
    for batch, size in ((None, 2), (2, None)):
        found = torch_samples(made, None, ["image"], shuffle=0, batch=batch)
        loader = torch.utils.data.DataLoader(found, batch_size=size)
        orders += [torch.cat([one["index"] for one in loader]).tolist() for _ in range(2)]
    assert orders[:2] == orders[2:] and orders[0] != orders[1]
    assert sorted(orders[0]) == list(range(6))
    again = pickle.loads(pickle.dumps(found))
    assert [batch["image"].shape for batch in again] == [(2, 32, 32)] * 3


def test_an_edited_shard_is_found(made, tmp_path):
    assert not check(made, remade=2).problems
    shutil.copytree(made.store.path, tmp_path, dirs_exist_ok=True)
    file = tmp_path / "arrays/image/c/1/0/0"
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    (tmp_path / "table/part-000000.parquet").unlink()
    found = check(DataSet(tmp_path))
    assert found.damaged == [0, 1]
    assert [problem.partition(";")[0] for problem in found.problems] == [
        "shard 0: table/part-000000.parquet is gone",
        "shard 1: arrays/image/c/1/0/0 is not what manifest.json says",
    ]


def test_a_repair_that_mends_nothing_says_so(made, monkeypatch, capsys):
    differs = Checked(remade=1, problems=["sample 3: image come out otherwise than stored"])
    monkeypatch.setattr("sonospline.commands.dataset.check", lambda *_, **__: differs)
    assert cli.main(["dataset", "check", str(made.store.path), "--remake", "1", "--repair", "--quiet"]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert "sample 3: image come out otherwise than stored" in said[0]


def test_the_numbers_are_plausible(made):
    found = statistics(made)
    assert found["samples"] == 6
    assert found["numbers"]["force_axial_n"]["least"] > 0
    assert found["numbers"]["error_estimate"]["largest"] <= 0.0125
    for row in made.rows():  # where the table says the needle is, it is
        length = np.linalg.norm(np.subtract(row["tip_mm"], row["entry_mm"]))
        assert length == pytest.approx(row["depth_mm"])
        assert row["entry_mm"][2] == pytest.approx(0, abs=1e-9)


PLANE = ImagePlane(
    image_to_reference=ss.facing((4, 10, 2), depth=(0, 0.6, 0.8), right=(1, 0, 0)), shape=(24, 32), spacing_mm=0.7
)
LABELS = Volume(
    voxels=np.random.default_rng(0).integers(0, 9, (30, 26, 28)).astype(np.uint8),
    spacing=(1.1, 1.3, 0.9),
    origin=(-3, 2, 1),
)


def constant(shift):
    grid = ss.Grid(shape=(6, 6, 6), spacing=12, origin=(-20, -20, -20))
    return ss.GridField(grid, np.broadcast_to(np.float32(shift), (*grid.shape, 3)).copy())


@pytest.mark.parametrize("stride", [1, 4])
def test_labels_are_those_of_the_tissue_that_lies_there_now(stride):
    """A body that moves as a whole: the tissue at a pixel is that which was there less the shift."""
    shift = np.array([1.7, -2.4, 3.1])
    moved = displacement_now(constant(shift), PLANE, stride)
    np.testing.assert_allclose(moved, np.broadcast_to(shift @ PLANE.image_to_reference[:3, :3], moved.shape), atol=1e-5)
    numbers = np.arange(256, dtype=np.uint8)
    numbers[3] = 77
    index = np.rint(LABELS.index(PLANE.points - shift)).astype(int)
    inside = ((index >= 0) & (index < LABELS.voxels.shape)).all(axis=1)
    at = np.where(inside[:, None], index, 0)
    expected = np.where(inside, numbers[LABELS.voxels[tuple(at.T)]], numbers[0]).reshape(PLANE.shape)
    assert (labels_now(LABELS, numbers, moved, PLANE) == expected).mean() > 0.995  # but for places half way between


@given(st.tuples(*[st.floats(-8, 8)] * 3), st.tuples(*[st.floats(-8, 8)] * 3).filter(lambda p: np.linalg.norm(p) > 1))
@settings(max_examples=30, deadline=None)
def test_needle_pixels_are_near_the_part_of_the_needle_in_the_slice(entry, way):
    probe = ss.Probe.linear(depth_mm=30)
    plane = ImagePlane.placed(np.eye(4), shape=(60, 60), spacing_mm=(0.5, 0.5), corner_mm=(-15, 0))
    entry = np.add(entry, (0, 12, 0))
    needle = ss.Needle(entry, entry + way)
    mask = needle_pixels(needle, 1.2, probe, plane)
    on = entry + np.linspace(0, 1, 400)[:, None] * np.asarray(way)
    half = np.sqrt(2 * np.log(2)) * probe.elevation_sigma(np.clip(on[:, 1], 0, 30)) + 0.6
    seen = on[np.abs(on[:, 2]) <= half]
    x, y = np.meshgrid(-15 + 0.5 * np.arange(60), 0.5 * np.arange(60))
    if not len(seen):
        away = np.full(mask.shape, np.inf)
    else:
        away = np.sqrt(((np.stack([x, y], -1)[:, :, None] - seen[:, :2]) ** 2).sum(-1)).min(-1)
    assert not mask[away > 0.6 + 0.55].any()
    assert mask[away < 0.6 - 0.1].all()


def test_splits_are_even_for_every_count():
    for count in (7, 64, 1000):
        shares = np.array([even(3, k) for k in range(count)])
        for low, high in ((0, 0.8), (0.8, 0.9), (0.9, 1)):
            assert abs(((shares >= low) & (shares < high)).mean() - (high - low)) <= (2 + np.log2(count)) / count


def test_streams_are_apart():
    first = {stream(7, of, number).random() for of in Stream for number in range(50)}
    assert len(first) == 50 * len(Stream)
    assert stream(8, Stream.SAMPLE, 3).random() not in first


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("[needle]\nangle_deg = [60, 30]", r"line 25: needle.angle_deg = \[60, 30\] is empty; give \[low, high\]"),
        ("[needle]\nangle_deg = [2, 30]", r"needle.angle_deg\[0\] = 2 is out of range; give a number from 5 to 90"),
        ("[needle]\nangel_deg = [2, 30]", "needle.angel_deg is not known; use"),
        ("[split]\ntrain = 0.9", "train \\+ validation \\+ test = 1.1; give shares that add up to 1"),
        ("[[sources]]\nkind = 'scene'", "scene is missing; give kidney, kidney-wide, gel, cube or a scene file"),
        ("[[sources]]\nkind = 'labels'\nscene = 'a.toml'", "folder is missing"),
        ("[[sources]]\nkind = 'block'\nscene = 'gel'", "is not for a block, which is drawn"),
    ],
)
def test_a_specification_that_cannot_be_is_refused_in_one_line(given, said):
    with pytest.raises(ValueError, match=said) as refused:
        Specification.parse(SMALL + given)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (SMALL + "[needle]\nangle_deg = [5, 7]", "6 of 6 samples tried reach outside the tissue: no needle fits"),
        (SMALL.replace("samples = 2", "samples = 2\nslide_mm = [150, 160]"), "no probe fits the skin"),
        (SMALL + "[target]\nnames = ['calyx']", r"target.names = \['calyx'\] are none of the scene's; it has tumour"),
        (
            "samples = 1\n[[sources]]\nkind = 'labels'\nfolder = 'none'\nscene = 'a.toml'",
            "folder = 'none'.*is not there",
        ),
    ],
)
def test_nothing_is_made_of_ranges_outside_the_tissue(asked, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        make_dataset(Specification.parse(asked), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_another_data_set_is_not_overwritten(made):
    with pytest.raises(ValueError, match="holds another data set; give a new folder"):
        make_dataset(small(seed=6), made.store.path)
    assert not check(made).problems


def test_a_folder_of_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ValueError, match="holds other files; give a new folder"):
        make_dataset(small(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_full_disk_leaves_nothing_half_written(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sonospline.dataset.store.os.fsync", full)
    with pytest.raises(StoreError, match=r"plan.json cannot be written \(No space left on device\); make room"):
        make_dataset(small(), tmp_path / "out")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_stores_are_alike(tmp_path):
    for store in (Folder(str(tmp_path / "a")), store_at("memory://alike")):
        assert store.names("deep/er") == []
        store.write("deep/er/one", b"1")
        store.write("deep/er/one", b"2")
        assert store.read("deep/er/one") == b"2"
        assert (store.size("deep/er/one"), store.size("two")) == (1, None)
        assert store.names("deep/er") == ["deep/er/one"]
        store.remove("deep/er/one")
        store.remove("deep/er/one")
        with pytest.raises(FileNotFoundError):
            store.read("deep/er/one")
    with pytest.raises(StoreError, match="address = 'nothing://x' cannot be used"):
        store_at("nothing://x")


@given(st.binary(max_size=60))
@settings(max_examples=40, deadline=None)
def test_what_is_no_recipe_is_refused(content):
    with pytest.raises(ValueError, match="recipe cannot be read"):
        Recipe.parse(content)


def test_the_schema_knows_every_table():
    assert {"sources", "anatomy", "view", "needle", "target", "stored", "storage"} <= set(
        specification_schema()["properties"]
    )
