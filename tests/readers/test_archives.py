"""Recordings in archives: read as their folders are, without being unpacked, whatever is wrong with them."""

from __future__ import annotations

import errno
import io
import os
import tarfile
import threading
import zipfile

import numpy as np
import pytest
from made_recordings import make_plain

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.formats import archives, cache
from cuboid.ground.formats.reading import MAX_TEXT_BYTES, UnreadableError, names_in, opened, read_bytes
from cuboid.ground.formats.stored import STORES_OPEN, StoredPath, local_file, located
from cuboid.inputs.readers import open_recording


def pack(folder, archive, compression=zipfile.ZIP_STORED, top=True):
    """Pack a folder into a zip or a tar, its own name on top or not."""
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    names = [str(file.relative_to(folder.parent if top else folder)) for file in files]
    if archive.suffix == ".tar":
        with tarfile.open(archive, "w") as tar:
            for file, name in zip(files, names, strict=True):
                tar.add(file, name)
    else:
        with zipfile.ZipFile(archive, "w", compression) as packed:
            for file, name in zip(files, names, strict=True):
                packed.write(file, name)
    return archive


def assert_same(recording, other, frames=(4, 0, 2)):
    assert (recording.format, len(recording)) == (other.format, len(other))
    for k in frames:
        one, two = recording.read(k), other.read(k)
        np.testing.assert_array_equal(one.color, two.color)
        np.testing.assert_array_equal(one.depth_m, two.depth_m)
        np.testing.assert_array_equal(one.T_world_camera, two.T_world_camera)


@pytest.mark.parametrize("name", ["a.zip", "packed.zip", "a.tar", "A.ZIP"])
@pytest.mark.parametrize("top", [True, False])
def test_a_recording_in_an_archive_is_that_of_its_folder(plain_folder, tmp_path, name, top):
    compression = zipfile.ZIP_DEFLATED if name == "packed.zip" else zipfile.ZIP_STORED
    archive = pack(plain_folder, tmp_path / name, compression, top)
    recording = open_recording(archive)
    assert str(recording.path) == (f"{archive}/mine" if top else str(archive))
    assert_same(recording, open_recording(plain_folder))
    assert_same(open_recording(str(recording.path)), recording)  # as results name it
    assert recording.color_name(0) == "color/000000.png"
    assert [frame.index for frame in recording.iterate(every=2)] == [0, 2, 4]
    assert not any(tmp_path.glob("*/000000.png"))


@pytest.fixture
def plain_folder(tmp_path):
    (tmp_path / "made").mkdir()
    return make_plain(tmp_path / "made").path


def test_an_archive_in_an_archive(plain_folder, tmp_path):
    inner = pack(plain_folder, tmp_path / "scan.zip")
    with tarfile.open(tmp_path / "all.tar", "w") as tar:
        tar.add(inner, "data/scan.zip")
    assert_same(open_recording(tmp_path / "all.tar" / "data" / "scan.zip"), open_recording(plain_folder))


def test_frames_that_are_damaged_are_skipped(plain_folder, tmp_path):
    archive = pack(plain_folder, tmp_path / "a.zip", zipfile.ZIP_DEFLATED)
    data = bytearray(archive.read_bytes())
    with zipfile.ZipFile(archive) as packed:
        at = packed.getinfo("mine/color/000003.png").header_offset + 80
        lost = packed.getinfo("mine/color/000004.png").header_offset
    data[at : at + 20] = bytes(20)
    data[lost : lost + 4] = b"lost"
    archive.write_bytes(data)
    recording = open_recording(archive)
    for k in (3, 4):
        with pytest.raises(FrameError, match=rf"color image color/00000{k}\.png cannot be read: cannot be unpacked"):
            recording.read(k)
    recording.read(2)


def test_a_tar_that_was_cut_short_gives_what_is_whole(plain_folder, tmp_path):
    archive = pack(plain_folder, tmp_path / "a.tar")
    with tarfile.open(archive) as tar:
        at = tar.getmember("mine/depth/000003.png").offset_data
    archive.write_bytes(archive.read_bytes()[: at + 5])
    recording = open_recording(archive)
    recording.without_poses().read(2)
    with pytest.raises(FrameError, match=r"color without depth"):
        recording.without_poses().read(4)


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.zip", b"PK\3\4 and no index", "no whole zip archive: File is not a zip file"),
        ("a.zip", b"", "no whole zip archive"),
        ("a.tar", b"x" * 3000, "no tar archive"),
        ("a.tar.gz", b"\x1f\x8b", r"it is packed as a whole; \.zip and \.tar are read without being unpacked"),
    ],
)
def test_what_is_no_archive_is_refused_in_one_line(tmp_path, name, data, says):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=rf"{name} cannot be read: {says}"):
        open_recording(tmp_path / name)


def test_an_absent_archive_and_an_empty_one(tmp_path):
    with pytest.raises(InputError, match=r"none\.zip does not exist"):
        open_recording(tmp_path / "none.zip")
    zipfile.ZipFile(tmp_path / "empty.zip", "w").close()
    with pytest.raises(InputError, match=r"empty\.zip is empty; a recording in one of"):
        open_recording(tmp_path / "empty.zip")
    (tmp_path / "folder.zip").mkdir()
    make_plain(tmp_path / "folder.zip")
    assert open_recording(tmp_path / "folder.zip").format == "plain"


def test_names_that_lead_out_of_an_archive_are_left_out(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        for name in ("../evil.txt", "/etc/evil.txt", "a/../../evil.txt", "./good/file.txt"):
            packed.writestr(name, "x")
    assert list(names_in(located(tmp_path / "a.zip"))) == ["good"]


def test_the_rules_of_the_door_hold_in_archives(tmp_path):
    """Regular files only, and no more of them than their kind can have."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("folder/text.txt", "hello")
        packed.writestr("large.txt", bytes(2000))
    with tarfile.open(tmp_path / "b.tar", "w") as tar:
        for name, kind in (("fifo", tarfile.FIFOTYPE), ("link", tarfile.SYMTYPE), ("device", tarfile.CHRTYPE)):
            info = tarfile.TarInfo(name)
            info.type, info.linkname = kind, "/etc/passwd"
            tar.addfile(info)
        info = tarfile.TarInfo("regular")
        info.size = 3
        tar.addfile(info, io.BytesIO(b"abc"))
    root, tar_root = located(tmp_path / "a.zip"), located(tmp_path / "b.tar")
    assert read_bytes(root / "folder" / "text.txt", 10) == b"hello"
    assert list(names_in(tar_root)) == ["regular"]
    for path, reason in (
        (root / "folder", "is a folder, a regular file was expected"),
        (root / "large.txt", "is larger than 0 MB, which no file of its kind is"),
        (root / "none.txt", "cannot be read: No such file or directory"),
        (tar_root / "link", "cannot be read: No such file or directory"),
    ):
        with pytest.raises(UnreadableError, match=reason), opened(path, 1000):
            pass
    with pytest.raises(OSError, match="can only be read"):
        (root / "new.txt").open("wb")
    assert MAX_TEXT_BYTES > 1000


def test_large_compressed_files_are_read_in_any_order_from_a_cache_with_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "MAX_IN_MEMORY", 1000)
    monkeypatch.setattr(cache, "CACHE", held := cache.Cache())
    data = [np.random.default_rng(k).bytes(400_000) for k in range(4)]
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as packed:
        for k, one in enumerate(data):
            packed.writestr(f"{k}.bag", one)
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "1")
    root = located(tmp_path / "a.zip")
    for k in (0, 1, 2, 3, 1):
        with (root / f"{k}.bag").open("rb") as file:
            file.seek(300_000)
            assert file.read(50) == data[k][300_000:300_050]
            file.seek(10)
            assert file.read(50) == data[k][10:60]
    kept = [path.stat().st_size for path in held._folder.iterdir()]
    assert 0 < sum(kept) <= 1 << 20
    assert local_file(root / "0.bag").read_bytes() == data[0]
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "0")
    with pytest.raises(OSError, match=r"more than the 0 MB that may be kept there; .* set CUBOID_CACHE_MB") as refused:
        local_file(root / "2.bag")
    assert refused.value.errno == errno.EFBIG


def test_an_encrypted_file_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        packed.writestr("secret.txt", "x" * 100)
    data = (tmp_path / "a.zip").read_bytes()
    at = data.rindex(b"PK\1\2") + 8
    (tmp_path / "a.zip").write_bytes(data[:at] + b"\1\0" + data[at + 2 :])
    with pytest.raises(UnreadableError, match="is encrypted"):
        read_bytes(located(tmp_path / "a.zip") / "secret.txt", 1000)


def test_many_archives_are_open_at_once_without_as_many_files(plain_folder, tmp_path):
    paths = [pack(plain_folder, tmp_path / f"{k}.zip") for k in range(2 * STORES_OPEN)]
    before = len(os.listdir("/proc/self/fd"))
    recordings = [open_recording(path) for path in paths]
    assert len(os.listdir("/proc/self/fd")) < before + STORES_OPEN + 8
    recordings[0].read(0)  # its archive was closed meanwhile


def test_threads_read_side_by_side(plain_folder, tmp_path):
    root = located(pack(plain_folder, tmp_path / "a.zip")) / "mine"
    want = {file.name: file.read_bytes() for file in (plain_folder / "color").iterdir()}
    faults = []

    def work(name):
        faults.extend(name for _ in range(40) if read_bytes(root / "color" / name, 1 << 20) != want[name])

    threads = [threading.Thread(target=work, args=(name,)) for name in want]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults


def test_paths_are_like_others(tmp_path):
    path = StoredPath("https://host/a/b.zip") / "c" / "d.png"
    assert str(path) == "https://host/a/b.zip/c/d.png"
    assert str(StoredPath(str(path))) == str(path)
    assert (path.name, path.suffix, str(path.parent)) == ("d.png", ".png", "https://host/a/b.zip/c")
    assert str(path.relative_to(StoredPath("https://host/a"))) == "b.zip/c/d.png"
    assert isinstance(path.parent, StoredPath)
    assert located(tmp_path) == tmp_path
    assert not isinstance(located(tmp_path), StoredPath)
