"""Every format, made in its own layout: its frames, and its faults, in tables."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import made_containers
import numpy as np
import pytest
from made_bags import encoded
from made_containers import LOSSLESS, LOSSY, Frames, netpbm, put, rows_of
from made_recordings import CAMERA, color_image, depth_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, Intrinsics, SkippedFrame
from cuboid.inputs.readers import Recording, open_recording
from cuboid.inputs.readers.bonn import SCALE, T_MARKERS_CAMERA
from cuboid.inputs.readers.recording import DEFAULT_RATE_HZ

SMALL = Intrinsics(**CAMERA)  # type: ignore[arg-type]
KNOWN = {"icl-nuim": Intrinsics(481.2, 480.0, 319.5, 239.5, 640, 480), "bonn": Intrinsics(60, 61, 320, 240, 640, 480)}
NEEDS = {"record3d": "OpenEXR", "record3d-file": "liblzfse"} | dict.fromkeys(
    ("ros-bag bag", "ros-bag db3", "ros-bag mcap", "realsense-bag"), "rosbags"
)
WRITERS = LOSSLESS | LOSSY | {"plain": made_containers.plain, "bonn": made_containers.bonn}
# Formats whose frames have no poses, formats without times, and up in the world of the others that know it.
UNPOSED = ("infinitam", "realsense-bag", "azure-kinect")
UNTIMED = ("icl-nuim", "7-scenes", "uw-rgbd-scenes-v2", "open3d", "replica", "scannet", "bop", "nerfstudio", "3rscan")
UNTIMED += ("infinitam",)
UP = {"arkitscenes": (0, 0, 1)} | dict.fromkeys(("record3d", "record3d-file", "polycam", "stray-scanner"), (0, 1, 0))
# What becomes of a file: its new contents, or those made of the old ones; None: it is removed.
Change = str | bytes | None | Callable[[bytes], str | bytes]


def pose(k: int) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.3, 0.4, -0.2]))[0]
    T[:3, 3] = 0.1 * k, 0.05 * k, 0.5
    return T


def frames_of(name: str, count: int) -> Frames:
    camera = KNOWN.get(name, SMALL)
    size = camera.height, camera.width
    color, depth_mm = (
        [make(k) for k in range(count)]
        for make in (lambda k: color_image(k, size), lambda k: depth_image(k, 1000, size))
    )
    return Frames(camera, color, depth_mm, [pose(k) for k in range(count)])


def written(name: str, root: Path, count: int = 4, **options: Any) -> tuple[Path, Frames]:
    """Write a recording; returns what to open, and its frames."""
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], reason=f"{name} is read with {NEEDS[name]}")
    frames = frames_of(name, count)
    return WRITERS[name](frames, root, **options), frames


def change(root: Path, changes: dict[str, Change]) -> None:
    """Change files, named by patterns."""
    for pattern, what in changes.items():
        for file in sorted(root.glob(pattern)) or [root / pattern]:
            if what is None:
                file.unlink()
            else:
                put(file, what(file.read_bytes()) if callable(what) else what)


def edited(**fields: Any) -> Change:
    """Give fields of a JSON document other values."""
    return lambda data: json.dumps(json.loads(data) | fields)


def listed(name: str, edit: Callable[[Any], object]) -> Change:
    """Edit a list or an object in a JSON document."""

    def of(data: bytes) -> str:
        document = json.loads(data)
        edit(document[name] if name else document)
        return json.dumps(document)

    return of


def lines(keep: Callable[[list[str]], Iterable[str]]) -> Change:
    """Keep some lines."""
    return lambda data: "\n".join(keep(data.decode().splitlines())) + "\n"


@pytest.mark.parametrize("name", [*LOSSLESS, *LOSSY])
def test_the_frames_are_those_of_which_it_was_made_in_any_order(tmp_path: Path, name: str) -> None:
    count = 11 if name in LOSSLESS and name not in KNOWN else 4  # 10 comes behind 9, not behind 1
    path, frames = written(name, tmp_path / "recording", count)
    recording = open_recording(path)
    assert (recording.format, len(recording)) == (name.partition(" ")[0], count)
    assert recording.has_poses == (name not in UNPOSED)
    assert recording.has_timestamps == (name not in UNTIMED)
    height, width = frames.color[0].shape[:2]
    times = 3 if name == "azure-kinect" else 1  # its images have fixed sizes: the frame is enlarged, in a corner
    if times == 1:
        np.testing.assert_allclose(recording.intrinsics.pinhole, frames.camera.pinhole, rtol=1e-6)
    for k in (count - 1, 0, 2):
        frame = recording.read(k)
        corner = slice(0, times * height, times), slice(0, times * width, times)
        color, depth_m = frame.color[corner], frame.depth_m[corner]
        assert np.abs(color.astype(int) - frames.color[k]).mean() <= (0 if name in LOSSLESS else 4)
        np.testing.assert_allclose(depth_m, frames.depth_mm[k] / 1000, atol=1.1e-3)
        assert frame.timestamp_s - recording.timestamp_s(0) == pytest.approx(k / DEFAULT_RATE_HZ, abs=5e-3)
        if name not in UNPOSED:
            np.testing.assert_allclose(frame.T_world_camera, frames.poses[k], atol=1e-6)
    if name in UP:
        np.testing.assert_allclose(recording.up_world, UP[name])
        np.testing.assert_allclose(recording.up_camera(1), pose(1)[:3, :3].T @ UP[name], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "poses"),
    [
        ("plain", "poses.txt"),
        ("tum", "groundtruth.txt"),
        ("7-scenes", "*.pose.txt"),
        ("uw-rgbd-scenes-v2", "pc/*.pose"),
    ],
)
def test_without_its_poses_it_is_a_recording_without(tmp_path: Path, name: str, poses: str) -> None:
    path, _ = written(name, tmp_path / "recording")
    change(tmp_path / "recording", {poses: None})
    recording = open_recording(path)
    assert not recording.has_poses
    assert recording.read(0).T_world_camera is None


def test_bonn_carries_the_poses_of_the_markers_to_the_camera(tmp_path: Path) -> None:
    path, frames = written("bonn", tmp_path / "recording", 3)
    recording = open_recording(path)
    assert (recording.format, len(recording)) == ("bonn", 3)
    assert (recording.intrinsics.fx, recording.distortion[0]) == (542.822841, 0.039903)
    frame = recording.read(2)
    np.testing.assert_allclose(frame.T_world_camera, frames.poses[2], atol=1e-5)
    assert frame.depth_m[240, 100] == pytest.approx(1.02, abs=1e-3)
    assert pytest.approx(1.0593, abs=1e-4) == SCALE  # by the matrix on the dataset's page
    np.testing.assert_allclose(T_MARKERS_CAMERA[:3, :3] @ T_MARKERS_CAMERA[:3, :3].T, np.eye(3), atol=1e-12)


# --- other layouts of a format: files that move, and changes ----------------------------------------------------------

OTHER_LAYOUTS: list[tuple[str, dict[str, str], dict[str, Change]]] = [
    ("sun3d", {}, {"extrinsics/20130512.txt": "0 0 0 0\n"}),  # an older one
    ("open3d", {"color": "image", "camera_intrinsic.json": "intrinsic.json"}, {}),
    ("open3d", {"trajectory.log": "scene/trajectory.log"}, {}),
    ("arkitscenes", {}, {"lowres_wide.traj": lines(lambda all_lines: all_lines[::2])}),  # the pose lies between two
    ("polycam", {"keyframes/images": "keyframes/corrected_images", "keyframes/cameras": "keyframes/corrected_cameras"},
     {"keyframes/images/0.png": b"", "keyframes/cameras/0.json": "{"}),
    ("polycam", {f"keyframes/{folder}/00000004.{kind}": f"keyframes/{folder}/100000000.{kind}"  # a digit more
                 for folder, kind in (("images", "png"), ("depth", "png"), ("cameras", "json"))}, {}),
    ("uw-rgbd-scenes-v2", {"pc/01.pose": "imgs/scene_01/01.pose"}, {}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "moves", "changes"), OTHER_LAYOUTS)
def test_other_layouts(tmp_path: Path, name: str, moves: dict[str, str], changes: dict[str, Change]) -> None:
    path, frames = written(name, tmp_path / "recording", 5)
    for old, new in moves.items():
        (path / new).parent.mkdir(exist_ok=True)
        shutil.move(path / old, path / new)
    change(path, changes)
    recording = open_recording(path)
    assert (recording.format, len(recording)) == (name, 5)
    for k in (3, 0):
        frame = recording.read(k)
        np.testing.assert_array_equal(frame.color, frames.color[k])
        np.testing.assert_allclose(frame.T_world_camera, frames.poses[k], atol=1e-3)


# --- color with twice as many pixels as depth -------------------------------------------------------------------------


def doubled(data: bytes) -> bytes:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    return encoded(".png", np.kron(image, np.ones((2, 2, 1), np.uint8)))


FINE_K = (120.0, 122.0, 63.5, 47.5)
FINE = np.array([[120.0, 0, 63.5, 0], [0, 122, 47.5, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
FINER: dict[str, dict[str, Change]] = {
    "3rscan": {
        "frame-*.color.png": doubled,
        "_info.txt": lambda data: (
            data.decode()
            .replace("m_colorWidth = 64", "m_colorWidth = 128")
            .replace("m_colorHeight = 48", "m_colorHeight = 96")
            + f"m_calibrationColorIntrinsic = {' '.join(map(str, FINE.ravel()))}\n"
        ),
    },
    "scannet": {"color/*.png": doubled, "intrinsic/intrinsic_color.txt": rows_of(FINE)},
    "nerfstudio": {
        "images/*.png": doubled,
        "transforms.json": edited(fl_x=120, fl_y=122, cx=64, cy=48, w=128, h=96, depth_unit_scale_factor=0.001),
    },
    "arkitscenes": {
        "lowres_wide/*.png": doubled,
        "lowres_wide_intrinsics/*.pincam": " ".join(map(str, (128, 96, *FINE_K))),
    },
}


@pytest.mark.parametrize("name", FINER)
def test_color_finer_than_depth(tmp_path: Path, name: str) -> None:
    path, _ = written(name, tmp_path / "recording")
    change(path, FINER[name])
    recording = open_recording(path)
    assert recording.intrinsics == Intrinsics(*FINE_K, 128, 96)
    depth_m = recording.read(2).depth_m
    assert (depth_m[40, 20], depth_m[40, 120]) == pytest.approx((1.02, 2.0), abs=1e-3)
    assert (depth_m[5:-5, 5:60] > 0).all()  # no holes though color has four times the pixels


# --- readings of low confidence ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("arkitscenes", "confidence/7_100.000.png"),
        ("stray-scanner", "confidence/000000.png"),
        ("polycam", "keyframes/confidence/00000000.png"),
    ],
)
def test_readings_of_low_confidence_are_none(tmp_path: Path, name: str, file: str) -> None:
    path, _ = written(name, tmp_path / "recording")
    sure = np.full((48, 64), 2, np.uint8)
    sure[:10] = 0
    put(path / file, encoded(".png", sure))
    depth_m = open_recording(path).read(0).depth_m
    assert (depth_m[:9] == 0).all()
    assert depth_m[20, 10] == pytest.approx(1.0)


# --- InfiniTAM: disparity ---------------------------------------------------------------------------------------------

CAMERAS = "64 48\n60 60\n31.5 23.5\n\n" * 2
BESIDE = "1 0 0 0.02\n0 1 0 0\n0 0 1 0\n\n"


@pytest.mark.parametrize(
    ("rule", "disparity"),
    [("1135.09 0.0819141", True), ("kinect 1135.09 0.0819141", True), ("affine 0.001 0", False), ("0 0", False)],
)
def test_infinitam_with_a_rule_for_depth_and_a_second_camera(tmp_path: Path, rule: str, disparity: bool) -> None:
    path, frames = written("infinitam", tmp_path / "recording")
    metres = frames.depth_mm[2] / 1000
    raw = np.where(metres > 0, 1135.09 - 8 * 0.0819141 * 60 / np.maximum(metres, 0.1), 2047).round().astype(np.uint16)
    changes = {"Frames/0002.pgm": netpbm(raw)} if disparity else {}
    change(path, {"calib.txt": CAMERAS + BESIDE + rule, **changes})
    recording = open_recording(path)
    np.testing.assert_allclose(recording.depth_camera.T_color_depth[:3, 3], [-0.02, 0, 0])
    depth_m = recording.read(2).depth_m
    assert depth_m[24, 10] == pytest.approx(1.02, abs=0.03 if disparity else 1e-3)  # a step of disparity
    assert depth_m[24, 50] == pytest.approx(2.0, abs=0.06 if disparity else 1e-3)
    assert depth_m[24, 63] == 0  # what only color sees: depth was carried to the left


# --- Open3D, nerfstudio: their own ways -------------------------------------------------------------------------------


def test_names_of_redwood_with_a_time_behind_the_number(tmp_path: Path) -> None:
    path, frames = written("open3d", tmp_path / "recording", 3)
    (path / "camera_intrinsic.json").unlink()
    (path / "color").rename(path / "rgb")
    for folder, step in (("rgb", 33333), ("depth", 33100)):
        for k in range(3):
            (path / folder / f"{k:06d}.png").rename(path / folder / f"{k + 1:05d}-{step * k:012d}.png")
    recording = open_recording(path, intrinsics=SMALL.pinhole)
    assert len(recording) == 3
    np.testing.assert_allclose(recording.read(2).T_world_camera, frames.poses[2], atol=1e-6)
    put(path / "camera.json", json.dumps(CAMERA | {"depth_units_per_metre": 1000}))
    assert open_recording(path).format == "plain"  # a camera.json makes it a plain folder


def test_nerfstudio_with_its_own_scale(tmp_path: Path) -> None:
    path, _ = written("nerfstudio", tmp_path / "recording")
    change(path, {"transforms.json": edited(depth_unit_scale_factor=0.0005)})
    assert open_recording(path).read(0).depth_m[24, 10] == pytest.approx(0.5)


# --- faults -----------------------------------------------------------------------------------------------------------

INF = (" ".join(["-inf"] * 4) + "\n") * 4
NAN_POSE = "the pose has NaN or infinite numbers"
EDIT = "transforms.json"

# Format, changes, and the frames that are then skipped with their reasons; others can be read.
FRAME_FAULTS: list[tuple[str, dict[str, Change], dict[int, str]]] = [
    ("icl-nuim", {"*.freiburg": lines(lambda found: found[1:])},
     {0: r"livingRoom2\.gt\.freiburg has no line for frame 0 \(3 lines\)"}),
    ("sun3d", {"depth/0000001-*.png": None}, {0: "color without depth: none within 20 ms of image/0000001"}),
    ("sun3d", {"extrinsics/*": lines(lambda found: [*found[:4]])}, {1: r"20140909\.txt has 4 rows, none for image 2"}),
    ("3rscan", {"frame-000000.pose.txt": "1 0\n", "frame-000001.depth.pgm": lambda data: data[:-1],
                "frame-000002.depth.pgm": b"P2\n1 1\n255\n0\n"},
     {0: r"no camera pose: frame-000000\.pose\.txt: expected the 16 numbers of a 4x4 matrix",
      1: r"frame-000001\.depth\.pgm is truncated \(\d+ bytes, expected \d+\)",
      2: r"frame-000002\.depth\.pgm is neither a binary PGM nor a PPM \(13 bytes\)"}),
    ("arkitscenes", {"*_intrinsics/7_100.000.pincam": "64 48 99 99 31.5 23.5",
                     "*_intrinsics/7_100.033.pincam": "64 48", "lowres_depth/7_100.067.png": None},
     {0: r"the camera of 7_100\.000\.png differs from the others: fx 99\.0, median 60\.0",
      1: r"7_100\.033\.pincam line 1: expected width height fx fy cx cy",
      2: r"color without depth: none of the time of lowres_wide/7_100\.067\.png"}),
    ("infinitam", {"Frames/0000.ppm": lambda data: data[:99], "Frames/0001.pgm": None,
                   "Frames/0002.pgm": netpbm(color_image(2))},
     {0: r"color image 0000\.ppm is truncated", 1: "color without depth",
      2: r"depth image 0002\.pgm must have one channel of 16 bits"}),
    ("replica", {"office0/traj.txt": lines(lambda found: found[:1])},
     {2: r"traj\.txt has 1 lines, none for frame 2"}),
    ("scannet", {"pose/1.txt": INF, "pose/2.txt": None},
     {1: rf"1\.txt: {NAN_POSE}", 2: r"the camera pose is missing: 2\.txt"}),
    ("scannet-sens", {"scene.sens": lambda data: data.replace(pose(1).astype("<f4").tobytes(),
                                                             np.full(16, -np.inf, "<f4").tobytes())},
     {1: f"frame 1: {NAN_POSE}"}),
    ("bop", {"scene_camera.json": listed("", lambda cameras: (
        cameras["1"]["cam_K"].__setitem__(0, 99.0), cameras["2"].pop("cam_t_w2c"), cameras.pop("3")))},
     {1: "image 1 has a camera or a depth scale of its own", 2: r"scene_camera\.json has no pose of image 2",
      3: r"scene_camera\.json has no (pose|camera) of image 3"}),
    ("nerfstudio", {EDIT: listed("frames", lambda frames: (
        frames[-1].update(transform_matrix="x"), frames[-2].update(fl_x=99.0)))},
     {0: "'transform_matrix' is no 4x4 matrix", 1: r"has a camera of its own \(fl_x\)"}),
    ("open3d", {"trajectory.log": lines(lambda found: found[:5] + found[10:])},
     {1: r"trajectory\.log has no pose of frame 1 \(3 poses\)"}),
    ("record3d", {"depth/0.exr": lambda data: data[: len(data) // 2], "depth/1.exr": None,
                  "metadata.json": listed("poses", lambda poses: poses.__setitem__(2, [0] * 7))},
     {0: r"depth image depth/0\.exr cannot be decoded", 1: "color without depth",
      2: r"frame 2 of metadata.json: .*quaternion has length 0"}),
    ("record3d", {"metadata.json": listed("poses", lambda poses: poses.pop())},
     {3: r"metadata.json has no pose of frame 3"}),
    ("polycam", {"keyframes/cameras/00000000.json": edited(fx=160.0), "keyframes/cameras/00000001.json": "{"},
     {0: "differs from the others: fx 160", 1: "not valid JSON"}),
    ("stray-scanner", {"odometry.csv": lines(lambda found: found[:2] + found[3:])},
     {1: r"odometry\.csv has no line for frame 1"}),
    ("stray-scanner", {"odometry.csv": lambda data: data + b"9, 9, 0, 0, 0, 0, 0, 0, 1\n",
                       "depth/000009.png": encoded(".png", depth_image(0, 1000))},
     {4: r"rgb\.mp4 has 4 pictures, none for frame 9"}),
    ("7-scenes", {"frame-000001.pose.txt": None}, {1: r"the camera pose is missing: frame-000001\.pose\.txt"}),
    *(("7-scenes", {"frame-000001.pose.txt": text}, {1: rf"frame-000001\.pose\.txt: {reason}"}) for text, reason in (
        ("inf inf inf inf\n" * 4, NAN_POSE),
        ("nan 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", NAN_POSE),
        ("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "the pose is not rigid"),
        ("-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "the pose is not rigid"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", "expected the 16 numbers of a 4x4 matrix"),
        ("", "expected the 16 numbers of a 4x4 matrix"),
    )),
    *(("uw-rgbd-scenes-v2", {"pc/01.pose": lines(lambda found, text=text: [found[0], text, *found[2:]])},
       {1: rf"01\.pose line 2: {reason}"}) for text, reason in (
        ("1 0 0", "expected qw qx qy qz tx ty tz, got '1 0 0'"),
        ("nan 0 0 0 1 1 1", "the pose has NaN"),
        ("0 0 0 0 1 1 1", "the quaternion has length 0"),
    )),
    *(("plain", {"poses.txt": lines(lambda found, text=text: [*found[:2], text, found[3]])},
       {2: reason}) for text, reason in (
        ("2 nan 0 0 0 0 0 1", f"line 3: {NAN_POSE}"),
        ("2 0 0 0 0 0 0 inf", f"line 3: {NAN_POSE}"),
        ("2 0 0 0 0 0 0 0", "line 3: the quaternion has length 0, expected 1"),
        ("2 0 0 0 0.5 0.5 0 1.5", "quaternion has length 1.66"),
    )),
    ("plain", {"poses.txt": lines(lambda found: found[1:])},
     {0: r"poses\.txt has no line for frame number 0 \(3 lines, 4 frames\)"}),
    ("tum", {"depth/1.png": None}, {1: r"depth image depth/1\.png is missing"}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "faults"), FRAME_FAULTS)
def test_faulty_frames_are_skipped(
    tmp_path: Path, name: str, changes: dict[str, Change], faults: dict[int, str]
) -> None:
    path, _ = written(name, tmp_path / "recording")
    change(tmp_path / "recording", changes)
    recording = open_recording(path)
    for number, reason in faults.items():
        with pytest.raises(FrameError, match=reason):
            recording.read(number)
        if name in ("7-scenes", "plain", "uw-rgbd-scenes-v2"):
            recording.without_poses().read(number)
    assert any(isinstance(item, Frame) for item in recording.iterate(prefetch=False))


MATRIX = [60.0, 0, 0, 0, 61.0, 0, 31.5, 23.5, 1]
INTRINSICS_TXT = "camera-intrinsics.txt"
# Format, changes, and the message with which the recording is then refused.
FILE_FAULTS: list[tuple[str, dict[str, Change], str]] = [
    ("icl-nuim", {"associations.txt": lambda data: data + b"x\n"}, r"associations\.txt line 5: expected '0 depth/0"),
    ("icl-nuim", {"*.freiburg": "1 2 3\n"}, r"freiburg line 1: expected number tx ty tz qx qy qz qw"),
    ("icl-nuim", {"*.freiburg": "inf 0 0 0 0 0 0 1\n"}, r"freiburg line 1: "),
    ("bonn", {"rgb.txt": "x rgb/0.png\n"}, r"rgb\.txt line 1: expected seconds, got 'x'"),
    ("sun3d", {"extrinsics/*": "1 0 0\n"}, r"20140909\.txt line 1: expected 4 numbers a row"),
    ("sun3d", {"intrinsics.txt": "0 0 0\n0 0 0\n0 0 1\n"}, r"intrinsics\.txt: expected the matrix fx 0 cx"),
    ("3rscan", {"_info.txt": lambda data: data + b"m_depthShift = 0\n"},
     r"_info\.txt: m_depthShift: expected a number above 0, got '0'"),
    ("3rscan", {"_info.txt": lambda data: data + b"m_calibrationDepthIntrinsic = 1 2\n"},
     r"_info\.txt: m_calibrationDepthIntrinsic: expected the 16 numbers"),
    ("arkitscenes", {"lowres_wide.traj": "3393.0 1 2 3\n"},
     r"lowres_wide\.traj line 1: expected timestamp rx ry rz tx ty tz"),
    ("arkitscenes", {"*_intrinsics/*": None}, r"lowres_wide_intrinsics: no camera of a frame can be read"),
    ("infinitam", {"calib.txt": "1 2 3"},
     r"calib\.txt: expected 26 numbers: two cameras of 6, a 3x4 matrix, and two for depth; got 3: '1 2 3'"),
    ("infinitam", {"calib.txt": CAMERAS.replace("60 60", "0 60", 1) + BESIDE + "0 0"},
     r"calib\.txt: expected width height fx fy cx cy of color"),
    ("infinitam", {"calib.txt": CAMERAS + BESIDE.replace("1 0 0", "2 0 0") + "0 0"},
     r"calib\.txt: the matrix of color to depth: .*rigid"),
    ("replica", {"cam_params.json": "{}"}, "expected 'camera' with fx, fy"),
    ("replica", {"cam_params.json": '{"camera": {"fx": 1}}'}, r"'camera\.fy' must be a number above 0, got None"),
    ("replica", {"office0/traj.txt": "1 2 3\n"}, r"traj\.txt line 1: expected the 16 numbers"),
    ("scannet", {"intrinsic/intrinsic_depth.txt": "1 0\n0 1\n"},
     r"intrinsic_depth\.txt: expected a 4x4 matrix, got 2 rows"),
    ("scannet-sens", {"scene.sens": lambda data: data[:200]}, r"scene\.sens: ends within its header"),
    ("bop", {"scene_camera.json": '{"0": {"cam_K": [1]}}'}, "image 0: expected 'cam_K' with 9 numbers, row by row"),
    ("nerfstudio", {EDIT: edited(frames=[])}, "expected 'frames'"),
    ("nerfstudio", {EDIT: edited(frames=[{"file_path": "images/0.png"}])},
     "no frame has a 'depth_file_path': the scene is without depth"),
    ("nerfstudio", {EDIT: edited(w=None)}, "'width' must be a number above 0, got None"),
    ("nerfstudio", {EDIT: edited(depth_unit_scale_factor=-1)}, "'depth_unit_scale_factor' must be a number above 0"),
    ("open3d", {"camera_intrinsic.json": "{"}, r"camera_intrinsic\.json line 1: not valid JSON"),
    ("open3d", {"camera_intrinsic.json": "[]"}, "expected a JSON object"),
    ("open3d", {"camera_intrinsic.json": '{"width": 64, "height": 48}'}, "expected 'intrinsic_matrix' with 9 numbers"),
    ("open3d", {"camera_intrinsic.json": json.dumps({"width": 64, "intrinsic_matrix": MATRIX})},
     "'height' must be a number"),
    ("open3d", {"trajectory.log": "0 0 1\n1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n"},
     r"trajectory\.log line 1: expected four"),
    ("open3d", {"trajectory.log": ""}, "holds no pose"),
    ("record3d", {"metadata.json": edited(K=[1])}, "expected 'K' with 9 numbers, column by column"),
    ("polycam", {"keyframes/cameras/*": None}, "no camera of a frame can be read"),
    ("stray-scanner", {"rgb.mp4": lambda data: data[: len(data) // 2]}, r"rgb\.mp4: cannot be read as a video"),
    ("stray-scanner", {"camera_matrix.csv": "900.0, 0.0\n"},
     r"camera_matrix\.csv line 1: expected three numbers a row"),
    *(("7-scenes", {"camera.json": None, INTRINSICS_TXT: text}, reason) for text, reason in (
        ("60 0 31.5\n0 61 23.5\n", "expected a 3x3 camera matrix, got 2 rows"),
        ("60 0\n0 61\n", r"camera-intrinsics\.txt:1: expected first second third, got 2 values"),
        ("60 5 31.5\n0 61 23.5\n0 0 1\n", "expected the matrix fx 0 cx, 0 fy cy, 0 0 1"),
        ("600 0 320\n0 600 240\n0 0 1\n", r"principal point \(320, 240\), from camera-intrinsics\.txt, lies out"),
    )),
    ("7-scenes", {"camera.json": edited(width=640, height=480)},
     r"images are 64x48, but the intrinsics \(camera\.json\) are for 640x480"),
    ("uw-rgbd-scenes-v2", {"pc/01.pose": "\n"}, r"01\.pose is empty"),
    ("tum", {"rgb.txt": "0.0\n"}, r"rgb\.txt line 1: expected 'timestamp filename', got '0\.0'"),
    ("tum", {"depth.txt": "# t\nnow depth/0.png\n"},
     r"depth\.txt line 2: expected seconds, got 'now' and a file's name"),
    ("tum", {"depth.txt": ""},
     r"no color image of rgb\.txt \(4\) has a depth image of depth\.txt \(0\) within 20 ms"),
    ("tum", {"groundtruth.txt": "0 0 0 0 0 0 1\n"}, r"groundtruth\.txt line 1: expected timestamp tx ty tz qx"),
    ("tum", {"groundtruth.txt": "# none\n"}, r"groundtruth\.txt holds no pose"),
    *(("plain", {name: text}, reason) for name, text, reason in (
        ("poses.txt", "0 0 0 0 0 0 1", r"poses\.txt line 1: expected number tx ty tz qx qy qz qw, got '0 0"),
        ("poses.txt", "zero 0 0 0 0 0 0 1", r"poses\.txt line 1: expected number"),
        ("poses.txt", "0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1", "line 2: a second line for frame number 0"),
        ("poses.txt", "99.5 0 0 0 0 0 0 1", r"no line begins with the number of a frame; .* 99\.5.*are 0"),
        ("poses.txt", "# nothing\n", "it has no lines"),
        ("timestamps.txt", "0 1.0\n", "no line for frame number 1"),
        ("camera.json", "{", r"camera\.json: is not JSON: truncated"),
        ("camera.json", "[]", "expected an object with fx, fy"),
        ("camera.json", json.dumps(CAMERA), r"the depth scale is not known.*--depth-scale"),
        ("camera.json", json.dumps(CAMERA | {"fy": 0}), "fy: expected a number of at least 0.001, got 0"),
        ("camera.json", json.dumps(CAMERA | {"cx": "left"}), "cx: expected a number, got 'left'"),
        ("camera.json", json.dumps(CAMERA | {"width": 64.5}), "width: expected a whole number, got 64.5"),
        ("camera.json", json.dumps(CAMERA | {"depth_scale": 1}), "field 'depth_scale' is unknown, expected fx"),
        ("camera.json", json.dumps({"fx": 60}), "'fy' is missing"),
    )),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "says"), FILE_FAULTS)
def test_faulty_files_are_named(tmp_path: Path, name: str, changes: dict[str, Change], says: str) -> None:
    path, _ = written(name, tmp_path / "recording")
    change(path if path.is_dir() else path.parent, changes)
    with pytest.raises(InputError, match=says) as raised:
        open_recording(path)
    assert "\n" not in str(raised.value)


# --- files with many frames -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("calibration", ["", "{}", '{"CalibrationInformation": {"Cameras": []}}'])
def test_azure_kinect_without_its_calibration_is_refused(tmp_path: Path, calibration: str) -> None:
    path, _ = written("azure-kinect", tmp_path / "a", calibration=calibration)
    says = r"its calibration\.json cannot be used: KeyError" if calibration else r"has no attachment calibration\.json"
    with pytest.raises(InputError, match=says):
        open_recording(path)


def test_azure_kinect_with_a_lost_depth_image(tmp_path: Path) -> None:
    path, _ = written("azure-kinect", tmp_path / "a", lost_depth=1)
    recording = open_recording(path)
    with pytest.raises(FrameError, match=r"color without depth: none within \d+ ms of the color image at 0\.03"):
        recording.read(1)
    recording.read(2)


def test_a_bag_of_the_realsense_sdk_without_color_is_refused(tmp_path: Path) -> None:
    path, _ = written("realsense-bag", tmp_path / "a", colored=False)
    with pytest.raises(InputError, match="holds no color images; both color and depth must have been recorded"):
        open_recording(path)


def said(path: Path) -> list[str]:
    """Return what is said about a recording and its frames."""
    try:
        recording: Recording = open_recording(path)
    except InputError as error:
        return [str(error)]
    return [one.reason for one in recording.iterate(prefetch=False) if isinstance(one, SkippedFrame)]


@pytest.mark.parametrize("name", ["scannet-sens", "azure-kinect", "ros-bag bag", "ros-bag db3", "ros-bag mcap"])
def test_a_truncated_file_gives_its_whole_frames_and_a_damaged_one_one_line(tmp_path: Path, name: str) -> None:
    path, frames = written(name, tmp_path / "a", 12 if "bag" in name else 4)
    file = path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")
    whole, rng = file.read_bytes(), np.random.default_rng(3)
    if name != "ros-bag db3" and "bag" not in name:
        file.write_bytes(whole[: len(whole) * 3 // 4])
        assert 1 <= len(open_recording(path)) <= len(frames.color)
    for trial in range(10 if name == "azure-kinect" else 40):  # its images are large
        data = bytearray(whole)
        if trial % 4 == 0:
            del data[int(rng.integers(16, len(data))) :]
        for at in rng.integers(4, min(len(data), 4000) if trial % 2 else len(data), 1 << (trial % 7)):
            if at < len(data):
                data[at] = rng.integers(256)
        file.write_bytes(data)
        assert all("\n" not in one for one in said(path))
