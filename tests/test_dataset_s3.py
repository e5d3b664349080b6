"""A data set in an object store: the same bits as in a folder, and one clear line where the store goes away."""

import pytest

from small_datasets import small
from sonospline.dataset import DataSet, make_dataset
from sonospline.dataset.store import StoreError

pytest.importorskip("s3fs", reason="needs s3fs")
server = pytest.importorskip("moto.server", reason="needs moto, with its server")
pytestmark = pytest.mark.slow


@pytest.fixture
def bucket(monkeypatch, request):
    """Address and options of a bucket of an S3 server in this process, and what ends it."""
    import s3fs

    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "testing")
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    endpoint = f"http://{host}:{port}"
    options = {"endpoint_url": endpoint, "config_kwargs": {"retries": {"max_attempts": 1}}}
    s3fs.S3FileSystem.clear_instance_cache()
    name = f"needles-{len(request.node.name)}"  # the server keeps what it has for as long as its process lives
    s3fs.S3FileSystem(**options).mkdir(name)
    yield f"s3://{name}/small", options, running.stop
    running.stop()
    s3fs.S3FileSystem.clear_instance_cache()


def test_an_object_store_holds_the_same_as_a_folder(bucket, tmp_path):
    address, options, _ = bucket
    make_dataset(small(), tmp_path)
    make_dataset(small(), address, options=options)
    data = DataSet(address, options)
    assert data.manifest["hash"] == DataSet(tmp_path).manifest["hash"]
    assert data.sample(3)["image"].any()
    data.store.remove("receipts/000001.json")
    assert make_dataset(small(), address, options=options).made == 2


def test_an_object_store_that_goes_away_is_said_in_one_line(bucket):
    address, options, stop = bucket

    def progress(done, of, failed):
        if done == 2:
            stop()

    with pytest.raises(
        StoreError, match=r"s3://needles-\d+/small: .* cannot be written .*run the same again"
    ) as refused:
        make_dataset(small(), address, options=options, progress=progress)
    assert "\n" not in str(refused.value)
