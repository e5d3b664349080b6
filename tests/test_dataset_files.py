"""What lies beside the samples of a data set: plan, manifest, and what describes the table."""

import hashlib
import io
import json
import tarfile

import numpy as np
import pytest

from small_datasets import small
from sonospline.dataset import DataSet, make_dataset
from sonospline.dataset.tar_form import read_tar
from sonospline.io.png import png

pytest.importorskip("pyarrow", reason="needs the extra 'data'")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recipes")
    make_dataset(small("recipe"), folder)
    return DataSet(folder)


def test_croissant_knows_the_files_of_the_table_by_their_hashes(made):
    *files, table = json.loads(made.store.read("croissant.json"))["distribution"]
    assert {one["contentUrl"]: one["sha256"] for one in files} == {
        name: hashlib.sha256(made.store.read(name)).hexdigest() for name in made.store.names("table")
    }
    assert [one["@id"] for one in table["containedIn"]] == [one["@id"] for one in files]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"format_version": 2}, "is of a later version; read it with a later Sonospline"),
        ({"format_version": "2"}, "is no complete data set"),
        ({"format": "other"}, "is no complete data set"),
        ({"specification": {}}, "is no complete data set"),
    ],
)
def test_a_manifest_of_a_later_version_or_of_something_else_is_not_read(changed, said, made, tmp_path):
    (tmp_path / "manifest.json").write_text(json.dumps(made.manifest | changed))
    with pytest.raises(ValueError, match=said):
        DataSet(tmp_path)


@pytest.mark.parametrize(
    ("changed", "said"), [({"format_version": 2}, "is of a later version"), ({"format": "other"}, "is no data set")]
)
def test_nothing_is_made_in_a_place_of_a_later_version_or_of_something_else(changed, said, made, tmp_path):
    plan = json.loads(made.store.read("plan.json"))
    (tmp_path / "plan.json").write_text(json.dumps(plan | changed))
    with pytest.raises(ValueError, match=said):
        make_dataset(small("recipe"), tmp_path)


GREY = png(np.arange(63, dtype=np.uint8).reshape(7, 9))


def shard_of(picture):
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as shard:
        member = tarfile.TarInfo("000000003.image.png")
        member.size = len(picture)
        shard.addfile(member, io.BytesIO(picture))
    return stream.getvalue()


@pytest.mark.parametrize(
    "picture",
    [GREY[:20], GREY[:50], GREY.replace(b"IDAT", b"PLTE"), png(np.zeros((7, 9, 3), np.uint8)), "filtered"],
    ids=["no header", "cut", "chunks", "colours", "filtered"],
)
def test_pictures_of_shards_are_read_and_those_of_other_writers_refused(picture):
    ((index, held),) = read_tar(shard_of(GREY))
    assert index == 3 and held["image"].tolist() == np.arange(63).reshape(7, 9).tolist()
    if picture == "filtered":
        pillow, stream = pytest.importorskip("PIL.Image", reason="needs the extra 'plot'"), io.BytesIO()
        pillow.fromarray(np.add.outer(np.arange(50), np.arange(60)).astype(np.uint8)).save(stream, "png")
        picture = stream.getvalue()
    with pytest.raises(ValueError, match="a picture of a shard was written by another program"):
        list(read_tar(shard_of(picture)))
