from __future__ import annotations

import json
from fractions import Fraction

import av
import numpy as np
import pytest

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import SkippedFrame
from cuboid.inputs.readers import open_recording

FRAMES, STEP_US = 4, 33_333
WIDE = {"color": (1280, 720), "depth": (320, 288)}


def camera(purpose, cx, cy, f, aspect, move, distortion):
    k1, k2, k3, k4, k5, k6, p2, p1 = distortion
    return {
        "Purpose": f"CALIBRATION_CameraPurpose{purpose}",
        "Intrinsics": {"ModelParameters": [cx, cy, f, f * aspect, k1, k2, k3, k4, k5, k6, 0, 0, p2, p1]},
        "Rt": {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": move},
    }


DOCUMENT = {
    "CalibrationInformation": {
        "Cameras": [
            camera("Depth", 0.5, 0.5, 0.5, 1.0, [0, 0, 0], [0] * 8),
            camera("PhotoVideo", 0.5, 0.5, 0.48, 4 / 3, [-0.032, 0, 0], [0] * 8),
        ]
    }
}


def make(path, document=DOCUMENT, depth_lost=()):
    with av.open(str(path), "w", "matroska", options={"allow_raw_vfw": "1"}) as file:
        color = file.add_stream("mjpeg", rate=30, width=1280, height=720, pix_fmt="yuvj422p")
        depth = file.add_stream("rawvideo", rate=30, width=320, height=288, pix_fmt="gray16be")
        for stream, name in ((color, "COLOR"), (depth, "DEPTH")):
            stream.metadata["title"] = name
            stream.time_base = Fraction(1, 1_000_000)
            stream.codec_context.time_base = Fraction(1, 1_000_000)
        if document is not None:
            file.add_attachment("calibration.json", "application/json", json.dumps(document).encode())
        for k in range(FRAMES):
            picture = np.full((720, 1280, 3), (200, 30 + 20 * k, 40), np.uint8)
            wall = np.full((288, 320), 1000 + 100 * k, np.uint16)
            wall[:20] = 0
            for stream, array, form in ((color, picture, "rgb24"), (depth, wall, "gray16le")):
                if stream is depth and k in depth_lost:
                    continue
                frame = av.VideoFrame.from_ndarray(array, format=form)
                frame.pts, frame.time_base = k * STEP_US, Fraction(1, 1_000_000)
                file.mux(stream.encode(frame))
        for stream in (color, depth):
            file.mux(stream.encode())
    return path


def test_a_real_file(data_dir):
    recording = open_recording(data_dir / "containers" / "azure-kinect")
    assert (recording.format, len(recording), recording.has_poses) == ("azure-kinect", 1, False)
    K, depth = recording.intrinsics, recording.depth_camera
    assert (K.width, K.height, *depth.size) == (1280, 720, 640, 576)
    assert (K.fx, K.cx, depth.fx, depth.cy) == pytest.approx((611.795, 639.304, 504.608, 348.830), abs=1e-3)
    assert depth.T_color_depth[0, 3] == pytest.approx(-0.03208, abs=1e-5)
    assert len(recording.distortion) == len(depth.distortion) == 8
    frame = recording.read(0)
    assert frame.color.shape == (720, 1280, 3)
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(1.443, abs=0.01)
    assert (frame.depth_m > 0).mean() > 0.5


def test_frames_of_a_made_one_in_any_order(tmp_path):
    recording = open_recording(make(tmp_path / "k.mkv"))
    assert len(recording) == FRAMES
    assert (recording.intrinsics.fx, recording.intrinsics.cy) == pytest.approx((614.4, 359.5))
    assert (recording.depth_camera.fx, recording.depth_camera.cx) == pytest.approx((256, 159.5))
    for k in (3, 0, 2):
        frame = recording.read(k)
        assert frame.timestamp_s == pytest.approx(k * 0.0333, abs=2e-3)
        assert frame.depth_m[360, 640] == pytest.approx(1.0 + 0.1 * k)
        assert frame.color[360, 640].astype(int) == pytest.approx((200, 30 + 20 * k, 40), abs=6)


def test_color_without_depth_is_skipped(tmp_path):
    recording = open_recording(make(tmp_path / "k.mkv", depth_lost=(1,)))
    with pytest.raises(FrameError, match=r"color without depth: none within 20 ms of the color image at 0\.03"):
        recording.read(1)
    recording.read(2)


@pytest.mark.parametrize(
    ("document", "says"),
    [
        (None, r"has no attachment calibration\.json"),
        ({}, r"its calibration\.json cannot be used: KeyError"),
        ({"CalibrationInformation": {"Cameras": []}}, "cannot be used"),
    ],
)
def test_a_file_without_its_calibration_is_refused(tmp_path, document, says):
    with pytest.raises(InputError, match=says):
        open_recording(make(tmp_path / "k.mkv", document))


def test_a_truncated_file_gives_its_whole_frames_and_a_damaged_one_no_traceback(tmp_path):
    path = make(tmp_path / "k.mkv")
    whole, rng = path.read_bytes(), np.random.default_rng(2)
    path.write_bytes(whole[: len(whole) * 3 // 4])
    frames = [item for item in open_recording(path).iterate(prefetch=False) if not isinstance(item, SkippedFrame)]
    assert 1 <= len(frames) < FRAMES
    for trial in range(40):
        data = bytearray(whole)
        for at in rng.integers(4, min(len(data), 4000) if trial % 2 else len(data), 1 << (trial % 7)):
            data[at] = rng.integers(256)
        path.write_bytes(data)
        try:
            said = [one.reason for one in open_recording(path).iterate(prefetch=False) if isinstance(one, SkippedFrame)]
        except InputError as error:
            said = [str(error)]
        assert all("\n" not in one for one in said)
