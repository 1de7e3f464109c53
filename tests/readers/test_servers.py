"""Recordings behind URLs: a server of the web and one of S3 on this machine."""

from __future__ import annotations

import sys
import zipfile

import numpy as np
import pytest
from made_bags import make_bag
from made_recordings import make_plain, write_image
from servers import serving
from test_archives import assert_same, pack

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.formats.stored import located
from cuboid.inputs.readers import open_recording

pytest.importorskip("fsspec", reason="URLs are read with fsspec: pip install '.[remote]'")


@pytest.fixture
def served(tmp_path):
    (tmp_path / "files").mkdir()
    with serving(tmp_path / "files") as server:
        yield server, tmp_path / "files"


def test_a_folder_and_an_archive_by_https_are_as_the_folder(served):
    server, folder = served
    local = open_recording(make_plain(folder).path)
    pack(folder / "mine", folder / "a.zip", zipfile.ZIP_DEFLATED)
    pack(folder / "mine", folder / "b.tar")
    for place in ("mine", "mine/", "a.zip", "b.tar", "a.zip?token=1"):
        recording = open_recording(f"{server.url}/{place}")
        assert_same(recording, local)
        assert str(recording.path).startswith(server.url)
    server.asked.clear()
    recording = open_recording(f"{server.url}/mine")
    assert not any("00000" in path for path in server.asked[:4])  # lists first
    assert recording.color_name(0) == "color/000000.png"


def test_of_a_large_archive_only_what_is_needed_is_fetched(served):
    server, folder = served
    made = make_plain(folder, frames=40)
    rng = np.random.default_rng(0)
    for k in range(40):  # noise, which PNG cannot make small
        write_image(made.color(k), rng.integers(0, 255, (480, 640, 3), np.uint8))
        write_image(made.depth(k), rng.integers(500, 3000, (480, 640), np.uint16))
    pack(made.path, folder / "a.zip")
    (made.path / "camera.json").write_text((made.path / "camera.json").read_text())
    size = (folder / "a.zip").stat().st_size
    recording = open_recording(f"{server.url}/a.zip", intrinsics=(500, 500, 320, 240))
    opening = server.sent
    recording.read(30)
    assert size > 40 << 20
    assert opening < 12 << 20  # the index, and five frames that tell the size
    assert server.sent - opening < 4 << 20


def test_bags_are_read_message_by_message(served):
    pytest.importorskip("rosbags", reason="bags are read with rosbags: pip install '.[ros]'")
    server, folder = served
    for name, kind, query in (("a.bag", "bag", "?signed=1"), ("b", "mcap", ""), ("c", "db3", "")):
        local = open_recording(make_bag(folder / name, kind))
        recording = open_recording(f"{server.url}/{local.path.relative_to(folder)}{query}")
        assert (recording.format, len(recording)) == ("ros-bag", len(local))
        np.testing.assert_array_equal(recording.read(2).color, local.read(2).color)
        np.testing.assert_array_equal(recording.pose(2), local.pose(2))


def test_faults_of_a_server_are_one_line(served):
    server, folder = served
    made = make_plain(folder, frames=9)
    recording = open_recording(f"{server.url}/mine")
    server.failing = ["000007.png"]
    with pytest.raises(FrameError, match=r"color/000007\.png cannot be read: the server fails: 500"):
        recording.read(7)
    recording.read(8)
    with pytest.raises(InputError, match=r"http://127\.0\.0\.1:\d+/nothing does not exist"):
        open_recording(f"{server.url}/nothing")
    server.failing = ["mine"]
    with pytest.raises(InputError, match=r"/mine/ cannot be read: the server fails: 500"):
        open_recording(f"{server.url}/mine")
    server.failing = []
    pack(made.path, folder / "cut.zip")
    (folder / "cut.zip").write_bytes((folder / "cut.zip").read_bytes()[:-30])
    with pytest.raises(InputError, match=r"/cut\.zip cannot be read: no whole zip archive"):
        open_recording(f"{server.url}/cut.zip")
    with pytest.raises(InputError, match=r"nosuch://a cannot be read: no such kind of URL"):
        open_recording("nosuch://a/b")


def test_a_server_that_is_gone(tmp_path):
    (tmp_path / "files").mkdir()
    with serving(tmp_path / "files") as server:
        url = server.url
    with pytest.raises(InputError, match=r"/a\.zip cannot be read: the server fails: .*[Cc]onnect"):
        open_recording(f"{url}/a.zip")


def test_a_server_that_gives_no_parts_of_files_is_told_apart(served):
    server, folder = served
    server.parts = False
    (folder / "a.zip").write_bytes(np.random.default_rng(0).bytes(3 << 20))
    with pytest.raises(InputError, match=r"a\.zip cannot be read: The HTTP server doesn't appear to support range"):
        open_recording(f"{server.url}/a.zip")
    local = open_recording(make_plain(folder).path)
    assert_same(open_recording(f"{server.url}/mine"), local)  # small files come whole


def test_without_fsspec_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(InputError, match=r"a URL needs fsspec, which is not installed: .* pip install '\.\[remote\]'"):
        open_recording("https://example.org/a.zip")


@pytest.fixture(scope="module")
def bucket():
    """A bucket of an S3 server in this process, and what uploads to it."""
    moto = pytest.importorskip("moto.server", reason="the S3 server of the tests is moto")
    boto3 = pytest.importorskip("boto3")
    pytest.importorskip("s3fs", reason="s3:// is read with s3fs: pip install '.[remote]'")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            patch.setenv(name, "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        server = moto.ThreadedMotoServer(port=0, verbose=False)
        server.start()
        host, port = server.get_host_and_port()
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        client = boto3.client("s3")
        client.create_bucket(Bucket="scans")
        yield client
        client.close()
        server.stop()


def test_a_folder_and_an_archive_in_a_bucket(bucket, tmp_path):
    made = make_plain(tmp_path)
    local = open_recording(made.path)
    for file in made.path.rglob("*"):
        if file.is_file():
            bucket.upload_file(str(file), "scans", f"house/{file.relative_to(tmp_path)}")
    bucket.upload_file(str(pack(made.path, tmp_path / "a.zip")), "scans", "house/a.zip")
    for place in ("s3://scans/house/mine", "s3://scans/house/a.zip"):
        recording = open_recording(place)
        assert str(recording.path).startswith(place)
        assert_same(recording, local)
    assert located("s3://scans/house/a.zip").is_dir()
    for place, says in (
        ("s3://scans/none", "s3://scans/none does not exist"),
        ("s3://nobucket/none", "s3://nobucket/none cannot be read: the server fails: .*NoSuchBucket"),
    ):
        with pytest.raises(InputError, match=says):
            open_recording(place)
