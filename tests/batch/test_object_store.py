"""Recordings and store on an object store, spoken to by its real protocol."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

from batches import content, recordings, run, states
from cuboid.fleet.store.compact import compact
from cuboid.fleet.store.find import find
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.services.queries.filters import Filters


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """A bucket of a server of S3 on this machine."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patched:
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
        }.items():
            patched.setenv(name, value)
        fsspec.filesystem("s3").mkdir("fleet")
        yield "s3://fleet"
        fsspec.filesystem("s3").clear_instance_cache()
    server.stop()


def test_a_batch_from_and_to_an_object_store(bucket: str, tmp_path: Path) -> None:
    source = recordings(tmp_path / "source", 3, 4)
    (source / "rec-01" / "camera.json").unlink()
    fsspec.filesystem("s3").put(str(source), "fleet/march", recursive=True)
    words = ("batch", f"{bucket}/march/*", "--output", f"{bucket}/store", "--workers", 2)
    done = run(*words)
    assert done.returncode == 3, done.stderr
    found = states(f"{bucket}/store")
    assert {name: state for name, (state, _) in found.items()} == {
        "rec-00": "done",
        "rec-01": "failed",
        "rec-02": "done",
    }
    assert "s3://fleet/march/rec-01" in (found["rec-01"][1] or ""), "the reason names the recording, not a copy of it"
    place = StoreFolder(f"{bucket}/store")
    files = place.names("results")
    assert sum(name.endswith("run.json") for name in files) == 2
    assert sum(name.endswith("report.html") for name in files) == 2
    assert place.read("index.html").startswith(b"<!doctype html>")
    (thing, _) = find(Tables(place.url), Filters(size_m=(0.29, 0.31)), more=("picture",))
    assert thing["picture"].startswith(b"\xff\xd8")
    before = content(place.url)
    again = run(*words)
    assert again.stdout.startswith("nothing to do; 2 done before"), again.stderr
    assert compact(place).runs == 0
    assert content(place.url) == before


def test_a_name_is_taken_once(bucket: str) -> None:
    place = StoreFolder(f"{bucket}/other")
    assert place.create("one", b"1")
    assert not place.create("one", b"2")
    assert place.read("one") == b"1"
