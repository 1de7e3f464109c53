"""Recordings of iPhones: Record3D's export, Polycam's raw data, and Stray Scanner."""

from __future__ import annotations

import json
import shutil
import struct
import sys
import types
import zipfile

import av
import cv2
import numpy as np
import pytest

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.record3d_file import packed_size


def gap_m(recording, a, b):
    """Median difference of the depths of two frames, one carried into the other by their poses."""
    one, other, K = recording.read(a), recording.read(b), recording.intrinsics
    v, u = np.nonzero(one.depth_m)
    points = K.points(u, v, one.depth_m[v, u])
    moved = se3.transform(se3.inverse(other.T_world_camera) @ one.T_world_camera, points)
    x, y = np.rint(K.pixels(moved)).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < K.width) & (y < K.height)
    there = other.depth_m[y[inside], x[inside]]
    return float(np.median(np.abs(there - moved[inside, 2])[there > 0]))


class TestRecord3D:
    @pytest.fixture(autouse=True)
    def _openexr(self):
        pytest.importorskip("OpenEXR", reason="depth of Record3D is read with OpenEXR: pip install '.[phone]'")

    def test_a_real_export(self, data_dir):
        recording = open_recording(data_dir / "containers" / "record3d-exr")
        assert (recording.format, len(recording), recording.has_poses) == ("record3d", 20, True)
        K, depth = recording.intrinsics, recording.depth_camera
        assert (K.width, K.height, *depth.size) == (480, 640, 192, 256)  # color shrunk by 3
        assert (3 * K.fx, 7.5 * depth.fx) == pytest.approx((1404.303, 1404.303), abs=0.01)
        assert 3 * (K.cx + 0.5) - 0.5 == pytest.approx(724.646, abs=0.01)
        assert [recording.timestamp_s(k) for k in (0, 1, 19)] == pytest.approx([0, 0.016668, 0.316693], abs=1e-5)
        frame = recording.read(0)
        assert frame.color.shape == (640, 480, 3)
        assert frame.depth_m.max() == pytest.approx(1.221, abs=1e-3)
        assert (frame.depth_m > 0).mean() > 0.95  # whole, though color has 6 times the pixels
        assert gap_m(recording, 0, 19) < 0.004  # poses and axes fit: with others it is twice that and more

    def test_without_openexr_the_extra_is_named(self, data_dir, monkeypatch):
        monkeypatch.setitem(sys.modules, "OpenEXR", None)
        with pytest.raises(InputError, match=r"pip install '\.\[phone\]'"):
            open_recording(data_dir / "containers" / "record3d-exr")


@pytest.fixture
def lzfse(monkeypatch):
    """The real library where it is installed; else one that packs in the only way that needs none: not at all."""
    try:
        import liblzfse
    except ImportError:
        liblzfse = types.ModuleType("liblzfse")
        liblzfse.error = type("error", (Exception,), {})
        liblzfse.compress = lambda data: b"bvx-" + struct.pack("<I", len(data)) + data + b"bvx$"
        liblzfse.decompress = lambda data: data[8:-4]
        monkeypatch.setitem(sys.modules, "liblzfse", liblzfse)
    return liblzfse


def make_r3d(path, lzfse, frames=3, compression=zipfile.ZIP_STORED):
    metadata = {"w": 720, "h": 960, "dw": 192, "dh": 256, "fps": 30, "K": [700, 0, 0, 0, 700, 0, 359.5, 479.5, 1]}
    T = np.diag([1.0, -1, -1, 1])
    w, x, y, z = se3.quat_wxyz_from_rotation(T[:3, :3])
    metadata["poses"] = [[x, y, z, w, 0.1 * k, 0, 0] for k in range(frames)]
    metadata["frameTimestamps"] = [0.5 + k / 30 for k in range(frames)]
    sure = np.full((256, 192), 2, np.uint8)
    sure[:40] = 0
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", compression) as archive:
        archive.writestr("metadata", json.dumps(metadata))
        for k in range(frames):
            picture = np.full((960, 720, 3), (30, 100, 50 + 40 * k), np.uint8)
            archive.writestr(f"rgbd/{k}.jpg", cv2.imencode(".jpg", picture)[1].tobytes())
            depth_m = np.full((256, 192), 1 + 0.01 * k, np.float32)
            depth_m[:, 100:] = 2 + 0.1 * np.random.default_rng(k).random((256, 92), np.float32)
            depth_m[0, 0] = np.nan
            archive.writestr(f"rgbd/{k}.depth", lzfse.compress(depth_m.tobytes()))
            archive.writestr(f"rgbd/{k}.conf", lzfse.compress(sure.tobytes()))
    return path


def rewritten(path, **members):
    """The archive with some members of rgbd/ replaced; None: left out."""
    with zipfile.ZipFile(path) as archive:
        found = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (found | {f"rgbd/{name.replace('_', '.')}": data for name, data in members.items()}).items():
            if data is not None:
                archive.writestr(name, data)


class TestRecord3DFile:
    @pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
    def test_a_file_in_any_order(self, tmp_path, lzfse, compression):
        make_r3d(tmp_path / "some" / "2024-05-01.r3d", lzfse, compression=compression)
        recording = open_recording(tmp_path)  # found beneath
        assert (recording.format, len(recording)) == ("record3d-file", 3)
        K = recording.intrinsics
        assert (K.width, K.height, K.fx, recording.depth_camera.size) == (720, 960, 700, (192, 256))
        for k in (2, 0, 1):
            frame = recording.read(k)
            assert frame.color[500, 300].astype(int) == pytest.approx((50 + 40 * k, 100, 30), abs=4)
            assert frame.depth_m[600, 200] == pytest.approx(1 + 0.01 * k)
            assert (frame.depth_m[:140] == 0).all()
            assert frame.timestamp_s == pytest.approx(0.5 + k / 30)
            np.testing.assert_allclose(frame.T_world_camera[:3, :3], np.eye(3), atol=1e-6)
        np.testing.assert_allclose(recording.up_world, [0, 1, 0])

    def test_what_was_unpacked_of_it(self, tmp_path, lzfse):
        with zipfile.ZipFile(make_r3d(tmp_path / "a.r3d", lzfse)) as archive:
            archive.extractall(tmp_path / "unpacked")
        (tmp_path / "unpacked" / "rgbd" / "0.conf").unlink()
        recording = open_recording(tmp_path / "unpacked")
        assert recording.read(0).depth_m[20, 200] == pytest.approx(1.0)

    def test_broken_frames_are_skipped(self, tmp_path, lzfse):
        path = make_r3d(tmp_path / "a.r3d", lzfse, frames=6)
        small = lzfse.compress(bytes(4 * 192 * 255))
        whole = lzfse.compress(bytes(4 * 192 * 256))
        rewritten(path, **{"0_depth": small, "1_depth": whole[:-5], "2_depth": b"", "3_jpg": None, "4_conf": b"bvx2"})
        recording = open_recording(path)
        for number, reason in (
            (0, r"rgbd/0\.depth is damaged: it makes 195840 bytes of depth or confidence, expected 196608"),
            (1, r"rgbd/1\.depth is damaged: it makes 0 bytes"),
            (2, r"rgbd/2\.depth is damaged: it makes 0 bytes"),
            (3, "depth without color"),
            (4, r"rgbd/4\.conf is damaged: it makes 0 bytes of depth or confidence, expected 49152"),
        ):
            with pytest.raises(FrameError, match=reason):
                recording.read(number)
        recording.read(5)

    def test_faulty_files_are_refused(self, tmp_path, lzfse):
        path = make_r3d(tmp_path / "a.r3d", lzfse)
        whole = path.read_bytes()
        path.write_bytes(whole[:-200])
        with pytest.raises(InputError, match=r"a\.r3d cannot be read: no whole zip archive: File is not a zip file"):
            open_recording(path)
        path.write_bytes(whole)
        with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("metadata", json.dumps({"w": 720, "h": 960, "K": [1] * 9, "dw": 0}))
        with pytest.raises(InputError, match=r"a\.r3d/metadata: 'dw' must be a number above 0, got 0"):
            open_recording(path)

    def test_without_the_library_the_extra_is_named(self, tmp_path, lzfse, monkeypatch):
        path = make_r3d(tmp_path / "a.r3d", lzfse)
        monkeypatch.setitem(sys.modules, "liblzfse", None)
        with pytest.raises(InputError, match=r"LZFSE needs pyliblzfse, .* pip install '\.\[phone\]'"):
            open_recording(path)

    def test_sizes_are_told_before_anything_is_unpacked(self):
        real = pytest.importorskip("liblzfse", reason="the real library: pip install '.[phone]'")
        rng = np.random.default_rng(0)
        for data in (
            b"",
            b"ab",
            bytes(200_000),
            rng.bytes(100_000),
            b"abcd" * 9,
            rng.integers(0, 9, 300_000).tobytes(),
        ):
            assert packed_size(real.compress(data)) == len(data)


def make_video(path, frames, size):
    width, height = size
    with av.open(str(path), "w") as file:
        stream = file.add_stream("mpeg4", rate=30, width=width, height=height, pix_fmt="yuv420p")
        stream.codec_context.gop_size = 5
        for k in range(frames):
            picture = np.full((height, width, 3), (20 * k % 256, 100, (200 - 10 * k) % 256), np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        file.mux(stream.encode())


def test_stray_scanner_without_its_video_is_refused(data_dir):
    with pytest.raises(InputError, match=r"rgb\.mp4 is missing: without it a recording of Stray Scanner has no color$"):
        open_recording(data_dir / "containers" / "stray-scanner")


def test_a_real_recording_of_stray_scanner_with_a_video_in_the_place_of_its_own(data_dir, tmp_path):
    real, copy = data_dir / "containers" / "stray-scanner", tmp_path / "scan"
    shutil.copytree(real, copy, copy_function=shutil.copyfile)
    copy.chmod(0o755)
    make_video(copy / "rgb.mp4", 30, (1920, 1440))
    recording = open_recording(copy)
    assert (recording.format, len(recording), recording.has_poses) == ("stray-scanner", 30, True)
    K, depth = recording.intrinsics, recording.depth_camera
    assert (K.width, K.height, *depth.size) == (640, 480, 256, 192)
    assert (3 * K.fx, 3 * (K.cx + 0.5) - 0.5) == pytest.approx((1352.0168, 962.04865), abs=1e-3)
    assert recording.timestamp_s(1) - recording.timestamp_s(0) == pytest.approx(0.016668, abs=1e-6)
    np.testing.assert_allclose(recording.pose(0)[:3, 3], [-0.029284708, 0.33176774, 0.21466155], atol=1e-8)
    depth_mm = cv2.imread(str(real / "depth" / "000009.png"), cv2.IMREAD_UNCHANGED)
    confidence = cv2.imread(str(real / "confidence" / "000009.png"), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(confidence)) <= {0, 1, 2}
    frame = recording.read(9)
    assert frame.depth_m.max() == pytest.approx(depth_mm[confidence > 0].max() / 1000, abs=2e-3)
    assert gap_m(recording, 0, 29) < 0.02  # poses and axes fit: 26 mm with others, 39 mm without poses
