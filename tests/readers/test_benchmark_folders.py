"""Benchmarks: ICL-NUIM, Bonn, SUN3D, 3RScan, ARKitScenes, InfiniTAM, each made in its own layout and read back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from made_recordings import color_image, depth_image, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.bonn import SCALE, T_MARKERS_CAMERA, T_ROS

FULL = (480, 640)


def turned(x, about=(0.0, 0.3, 0.0), y=0.0):
    """A pose that moves along x and has turned."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array(about))[0]
    T[:2, 3] = x, y
    return T


def tum_text(number, T):
    w, x, y, z = se3.quat_wxyz_from_rotation(T[:3, :3])
    return f"{number} {T[0, 3]} {T[1, 3]} {T[2, 3]} {x} {y} {z} {w}\n"


def text_of(matrix):
    return "\n".join(" ".join(f"{value:.9f}" for value in row) for row in matrix) + "\n"


def write_netpbm(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    kind, largest = ("P6", 255) if image.ndim == 3 else ("P5", 65535)
    height, width = image.shape[:2]
    pixels = image if image.ndim == 3 else image.astype(">u2")
    path.write_bytes(f"{kind}\n# made\n{width} {height}\n{largest}\n".encode() + pixels.tobytes())


# --- ICL-NUIM ---------------------------------------------------------------------------------------------------------


def make_icl(scene, frames=3):
    for k in range(frames):
        write_image(scene / "rgb" / f"{k}.png", color_image(k, FULL))
        write_image(scene / "depth" / f"{k}.png", depth_image(k, 5000, FULL))
    lines = [f"{k} depth/{k}.png {k} rgb/{k}.png\n" for k in range(frames)]
    (scene / "associations.txt").write_text("".join(lines))
    poses = "".join(tum_text(k, turned(0.1 * k, (0.3, 0.2, 0), 0.5)) for k in range(1, frames))
    (scene / "livingRoom2.gt.freiburg").write_text(poses)
    return scene


def test_icl_nuim_turns_its_left_handed_axes(tmp_path):
    recording = open_recording(make_icl(tmp_path / "living_room_traj2_frei_png"))
    assert (recording.format, len(recording)) == ("icl-nuim", 3)
    assert recording.intrinsics == Intrinsics(481.2, 480.0, 319.5, 239.5, 640, 480)
    frame = recording.read(2)
    assert frame.depth_m[0, 1] == pytest.approx(1.02, abs=1e-4)
    np.testing.assert_allclose(frame.T_world_camera, turned(0.2, (-0.3, 0.2, 0), -0.5), atol=1e-8)
    with pytest.raises(FrameError, match=r"livingRoom2\.gt\.freiburg has no line for frame 0 \(2 lines\)"):
        recording.read(0)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("associations.txt", "0 depth/0.png 0 rgb/0.png\nx\n", r"associations\.txt line 2: expected '0 depth/0"),
        ("livingRoom2.gt.freiburg", "1 2 3\n", r"freiburg line 1: expected number tx ty tz qx qy qz qw"),
        ("livingRoom2.gt.freiburg", "inf 0 0 0 0 0 0 1\n", r"freiburg line 1: "),
    ],
)
def test_faulty_files_of_icl_nuim_are_named(tmp_path, name, text, says):
    scene = make_icl(tmp_path / "icl")
    (scene / name).write_text(text)
    with pytest.raises(InputError, match=says):
        open_recording(scene)


# --- Bonn -------------------------------------------------------------------------------------------------------------


def make_bonn(scene, frames=3):
    T_markers = [T_ROS @ turned(0.1 * k) @ np.linalg.inv(T_MARKERS_CAMERA) @ T_ROS for k in range(frames)]
    for k in range(frames):
        write_image(scene / "rgb" / f"{k}.png", color_image(k, FULL))
        write_image(scene / "depth" / f"{k}.png", depth_image(k, 5000 / SCALE, FULL))
    for kind in ("rgb", "depth"):
        (scene / f"{kind}.txt").write_text("".join(f"{k / 30:.6f} {kind}/{k}.png\n" for k in range(frames)))
    truth = "".join(tum_text(f"{k / 30:.6f}", T) for k, T in enumerate(T_markers))
    (scene / "groundtruth.txt").write_text(f"# ground truth\n{truth}")
    return scene


def test_bonn_carries_the_markers_poses_to_the_camera(tmp_path):
    recording = open_recording(make_bonn(tmp_path / "rgbd_bonn_balloon"))
    assert (recording.format, len(recording)) == ("bonn", 3)
    assert recording.intrinsics.fx == 542.822841
    assert recording.distortion[0] == 0.039903
    frame = recording.read(2)
    np.testing.assert_allclose(frame.T_world_camera, turned(0.2), atol=1e-5)
    assert frame.depth_m[240, 100] == pytest.approx(1.02, abs=2e-4)
    assert pytest.approx(1.0593, abs=1e-4) == SCALE  # by the matrix on the dataset's page
    np.testing.assert_allclose(T_MARKERS_CAMERA[:3, :3] @ T_MARKERS_CAMERA[:3, :3].T, np.eye(3), atol=1e-12)


def test_faulty_files_of_bonn_are_named(tmp_path):
    scene = make_bonn(tmp_path / "rgbd_bonn_static")
    (scene / "rgb.txt").write_text("x rgb/0.png\n")
    with pytest.raises(InputError, match=r"rgb\.txt line 1: expected seconds, got 'x'"):
        open_recording(scene)


# --- SUN3D ------------------------------------------------------------------------------------------------------------


def make_sun3d(scene, frames=3):
    poses = []
    for k in range(frames):
        write_image(scene / "image" / f"{k + 1:07d}-{33_000 * k:012d}.jpg", color_image(k))
        raw = depth_image(k, 1000)
        write_image(scene / "depth" / f"{k + 1:07d}-{33_000 * k + 4000:012d}.png", (raw << 3) | (raw >> 13))
        poses.append(text_of(turned(0.1 * k)[:3]))
    (scene / "intrinsics.txt").write_text("60 0 31.5\n0 61 23.5\n0 0 1\n")
    (scene / "extrinsics").mkdir()
    (scene / "extrinsics" / "20130512130736.txt").write_text("0 0 0 0\n")  # an older one
    (scene / "extrinsics" / "20140909153047.txt").write_text("".join(poses))
    return scene


def test_sun3d(tmp_path):
    recording = open_recording(make_sun3d(tmp_path / "maryland_hotel3"))
    assert (recording.format, len(recording)) == ("sun3d", 3)
    assert recording.intrinsics == Intrinsics(60, 61, 31.5, 23.5, 64, 48)
    frame = recording.read(2)
    assert frame.timestamp_s == pytest.approx(0.066)
    assert frame.depth_m[0, 1] == pytest.approx(1.02)
    np.testing.assert_allclose(frame.T_world_camera, turned(0.2), atol=1e-8)


def test_faults_of_sun3d(tmp_path):
    scene = make_sun3d(tmp_path / "scene")
    newest = scene / "extrinsics" / "20140909153047.txt"
    newest.write_text("\n".join(newest.read_text().splitlines()[:4]))
    (scene / "depth" / "0000001-000000004000.png").unlink()
    recording = open_recording(scene)
    with pytest.raises(FrameError, match=r"20140909153047\.txt has 4 rows, none for image 2"):
        recording.read(1)
    with pytest.raises(FrameError, match=r"color without depth: none within 20 ms of image/0000001"):
        recording.read(0)
    newest.write_text("1 0 0\n")
    with pytest.raises(InputError, match=r"20140909153047\.txt line 1: expected 4 numbers a row"):
        open_recording(scene)
    (scene / "intrinsics.txt").write_text("0 0 0\n0 0 0\n0 0 1\n")
    newest.unlink()
    with pytest.raises(InputError, match=r"intrinsics\.txt: expected the matrix fx 0 cx"):
        open_recording(scene)


# --- 3RScan -----------------------------------------------------------------------------------------------------------

INFO = {
    "m_versionNumber": "4",
    "m_colorWidth": "128",
    "m_colorHeight": "96",
    "m_depthWidth": "64",
    "m_depthHeight": "48",
    "m_depthShift": "1000",
    "m_calibrationColorIntrinsic": "120 0 63.5 0 0 120 47.5 0 0 0 1 0 0 0 0 1",
    "m_calibrationDepthIntrinsic": "60 0 31.5 0 0 60 23.5 0 0 0 1 0 0 0 0 1",
    "m_frames.size": "3",
}


def write_info(folder, **other):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "_info.txt").write_text("".join(f"{name} = {value}\n" for name, value in (INFO | other).items()))


def make_3rscan(scan, frames=3):
    folder = scan / "sequence"
    write_info(folder)
    for k in range(frames):
        write_image(folder / f"frame-{k:06d}.color.jpg", color_image(k, (96, 128)))
        write_netpbm(folder / f"frame-{k:06d}.depth.pgm", depth_image(k, 1000))
        (folder / f"frame-{k:06d}.pose.txt").write_text(text_of(turned(0.1 * k)))
    return scan


def test_3rscan_with_color_finer_than_depth(tmp_path):
    recording = open_recording(make_3rscan(tmp_path / "0958220d"))
    assert (recording.format, len(recording)) == ("3rscan", 3)
    assert recording.intrinsics == Intrinsics(120, 120, 63.5, 47.5, 128, 96)
    frame = recording.read(2)
    assert frame.depth_m[40, 20] == pytest.approx(1.02)
    assert frame.depth_m[40, 120] == pytest.approx(2.0)
    np.testing.assert_allclose(frame.T_world_camera, turned(0.2), atol=1e-8)


def test_faults_of_3rscan(tmp_path):
    folder = make_3rscan(tmp_path / "scan") / "sequence"
    depth = folder / "frame-000001.depth.pgm"
    depth.write_bytes(depth.read_bytes()[:-1])
    (folder / "frame-000002.depth.pgm").write_bytes(b"P2\n1 1\n255\n0\n")
    (folder / "frame-000000.pose.txt").write_text("1 0\n")
    recording = open_recording(folder)
    with pytest.raises(
        FrameError, match=r"no camera pose: frame-000000\.pose\.txt: expected the 16 numbers of a 4x4 matrix"
    ):
        recording.read(0)
    with pytest.raises(FrameError, match=r"frame-000001\.depth\.pgm is truncated \(\d+ bytes, expected \d+\)"):
        recording.read(1)
    with pytest.raises(FrameError, match=r"frame-000002\.depth\.pgm is neither a binary PGM nor a PPM \(13 bytes\)"):
        recording.read(2)
    write_info(folder, m_depthShift="0")
    with pytest.raises(InputError, match=r"_info\.txt: m_depthShift: expected a number above 0, got '0'"):
        open_recording(folder)
    write_info(folder, m_calibrationDepthIntrinsic="1 2")
    with pytest.raises(InputError, match=r"_info\.txt: m_calibrationDepthIntrinsic: expected the 16 numbers"):
        open_recording(folder)


# --- ARKitScenes ------------------------------------------------------------------------------------------------------


def make_arkitscenes(scan, frames=4, folder="lowres_wide", shape=(48, 64)):
    name, scale = scan.name, shape[1] / 64
    inner = scan / f"{name}_frames"
    lines = []
    for k in range(frames):
        time = f"{3393 + 0.1 * k:.3f}"
        write_image(inner / folder / f"{name}_{time}.png", color_image(k, shape))
        write_image(inner / "lowres_depth" / f"{name}_{time}.png", depth_image(k, 1000))
        sure = np.full((48, 64), 2, np.uint8)
        sure[:10] = 0
        write_image(inner / "confidence" / f"{name}_{time}.png", sure)
        camera = inner / f"{folder}_intrinsics" / f"{name}_{time}.pincam"
        camera.parent.mkdir(exist_ok=True)
        camera.write_text(f"{shape[1]} {shape[0]} {60 * scale} {60 * scale} {32 * scale - 0.5} {24 * scale - 0.5}")
        T = se3.inverse(turned(0.1 * k))
        rotation = cv2.Rodrigues(T[:3, :3])[0].ravel()
        if k % 2 == 0:
            lines.append(" ".join(map(str, (time, *rotation, *T[:3, 3]))) + "\n")
    (inner / "lowres_wide.traj").write_text("".join(lines))
    return scan


def test_arkitscenes(tmp_path):
    recording = open_recording(make_arkitscenes(tmp_path / "41048190"))
    assert (recording.format, len(recording)) == ("arkitscenes", 4)
    assert recording.intrinsics == Intrinsics(60, 60, 31.5, 23.5, 64, 48)
    assert recording.depth_camera is None
    frame = recording.read(1)  # its pose lies between two lines
    assert frame.timestamp_s == pytest.approx(3393.1)
    assert frame.depth_m[20, 1] == pytest.approx(1.01)
    assert (frame.depth_m[:10] == 0).all()
    np.testing.assert_allclose(frame.T_world_camera, turned(0.1), atol=1e-6)
    np.testing.assert_allclose(recording.up_world, [0, 0, 1])
    np.testing.assert_allclose(recording.up_camera(1), turned(0.1)[:3, :3].T @ [0, 0, 1], atol=1e-6)


def test_arkitscenes_with_finer_color(tmp_path):
    recording = open_recording(make_arkitscenes(tmp_path / "41048190", folder="vga_wide", shape=(192, 256)))
    assert recording.intrinsics == Intrinsics(240, 240, 127.5, 95.5, 256, 192)
    depth_m = recording.read(0).depth_m
    assert depth_m[100, 20] == pytest.approx(1.0)
    assert depth_m[100, 200] == pytest.approx(2.0)


def test_faults_of_arkitscenes(tmp_path):
    inner = make_arkitscenes(tmp_path / "7") / "7_frames"
    (inner / "lowres_wide_intrinsics" / "7_3393.000.pincam").write_text("64 48 99 99 31.5 23.5")
    (inner / "lowres_wide_intrinsics" / "7_3393.100.pincam").write_text("64 48")
    (inner / "lowres_depth" / "7_3393.200.png").unlink()
    recording = open_recording(inner)
    for number, reason in (
        (0, r"the camera of 7_3393\.000\.png differs from the others: fx 99\.0, median 60\.0"),
        (1, r"7_3393\.100\.pincam line 1: expected width height fx fy cx cy"),
        (2, r"color without depth: none of the time of lowres_wide/7_3393\.200\.png"),
        (3, r"no camera pose at 3393\.300 s"),
    ):
        with pytest.raises(FrameError, match=reason):
            recording.read(number)
    (inner / "lowres_wide.traj").write_text("3393.0 1 2 3\n")
    with pytest.raises(InputError, match=r"lowres_wide\.traj line 1: expected timestamp rx ry rz tx ty tz"):
        open_recording(inner)
    for file in (inner / "lowres_wide_intrinsics").iterdir():
        file.unlink()
    with pytest.raises(InputError, match=r"lowres_wide_intrinsics: no camera of a frame can be read"):
        open_recording(inner)


# --- InfiniTAM --------------------------------------------------------------------------------------------------------

CAMERAS = "64 48\n60 60\n31.5 23.5\n\n64 48\n60 60\n31.5 23.5\n\n"
BESIDE = "1 0 0 0.02\n0 1 0 0\n0 0 1 0\n\n"


def make_infinitam(scene, frames=3, rule="1135.09 0.0819141", disparity=True):
    for k in range(frames):
        metres = depth_image(k, 1000) / 1000
        raw = np.where(metres > 0, 1135.09 - 8 * 0.0819141 * 60 / np.maximum(metres, 0.1), 2047)
        write_netpbm(scene / "Frames" / f"{k:04d}.ppm", color_image(k))
        write_netpbm(scene / "Frames" / f"{k:04d}.pgm", (raw if disparity else 1000 * metres).round().astype(np.uint16))
    (scene / "calib.txt").write_text(CAMERAS + BESIDE + rule + "\n")
    return scene


@pytest.mark.parametrize(
    ("rule", "disparity"),
    [
        ("1135.09 0.0819141", True),
        ("kinect 1135.09 0.0819141", True),
        ("affine 0.001 0", False),
        ("0 0", False),
    ],
)
def test_infinitam(tmp_path, rule, disparity):
    recording = open_recording(make_infinitam(tmp_path / "teddy", rule=rule, disparity=disparity))
    assert (recording.format, len(recording), recording.has_poses) == ("infinitam", 3, False)
    assert recording.intrinsics == Intrinsics(60, 60, 31.5, 23.5, 64, 48)
    np.testing.assert_allclose(recording.depth_camera.T_color_depth[:3, 3], [-0.02, 0, 0])
    frame = recording.read(2)
    np.testing.assert_array_equal(frame.color, color_image(2))
    assert frame.depth_m[24, 10] == pytest.approx(1.02, abs=0.03 if disparity else 1e-3)  # a step of disparity
    assert frame.depth_m[24, 50] == pytest.approx(2.0, abs=0.06 if disparity else 1e-3)
    assert frame.depth_m[24, 63] == 0  # what only color sees: depth was carried to the left


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 2 3", "expected 26 numbers: two cameras of 6, a 3x4 matrix, and two for depth; got 3: '1 2 3'"),
        (CAMERAS.replace("60 60", "0 60", 1) + BESIDE + "0 0", "expected width height fx fy cx cy of color"),
        (CAMERAS + BESIDE.replace("1 0 0", "2 0 0") + "0 0", "the matrix of color to depth: .*rigid"),
    ],
)
def test_faulty_calibrations_of_infinitam_are_named(tmp_path, text, says):
    scene = make_infinitam(tmp_path / "teddy")
    (scene / "calib.txt").write_text(text)
    with pytest.raises(InputError, match=rf"calib\.txt: {says}"):
        open_recording(scene)


def test_broken_frames_of_infinitam_are_skipped(tmp_path):
    scene = make_infinitam(tmp_path / "teddy", frames=4)
    (scene / "Frames" / "0000.ppm").write_bytes((scene / "Frames" / "0000.ppm").read_bytes()[:99])
    (scene / "Frames" / "0001.pgm").unlink()
    write_netpbm(scene / "Frames" / "0002.pgm", color_image(2))
    recording = open_recording(scene)
    for number, reason in (
        (0, r"color image 0000\.ppm is truncated"),
        (1, "color without depth"),
        (2, r"depth image 0002\.pgm must have one channel of 16 bits"),
    ):
        with pytest.raises(FrameError, match=reason):
            recording.read(number)
    recording.read(3)
