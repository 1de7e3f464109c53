"""Poses of a rig's cameras from a ChArUco board, and its print."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from cuboid.cli import main
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.se3 import angle, exp, inverse
from cuboid.inputs.calibration.board import DICTIONARY, Board, board_of, board_pdf
from cuboid.inputs.calibration.board_fit import BoardFit, BoardSeen, fit_board
from cuboid.inputs.recordings.opening import open_recording
from cuboid.inputs.recordings.rig import RigRecording
from made_rigs import POSES as RIG_POSES
from made_rigs import WIDE, write_camera
from made_scenes import look_at, write_plain

BOARD = Board()
CAMERAS = (Intrinsics(610.0, 612.0, 321.3, 238.1, 640, 480), Intrinsics(560.0, 560.0, 318.0, 242.5, 640, 480))
POSES = tuple(look_at(eye, (0.0, 0.0, 0.0)) for eye in ((0.5, 0.1, 0.7), (-0.1, 0.55, 0.65)))
# Finer than the images, in which a module of the print has about four pixels.
TEXTURE_PX, FINE = 8, 4


def board_at(x: float, y: float, turn: float, tilt: float) -> np.ndarray:
    """T_world_board (4, 4) of a board that lies near the middle, its face up."""
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T[:3, 3] = x, y, 0.0
    T = T @ exp((0.0, 0.0, 0.0, tilt, -tilt / 2, turn))
    middle = np.eye(4)
    middle[:3, 3] = -BOARD.columns * BOARD.square_m / 2, -BOARD.rows * BOARD.square_m / 2, 0.0
    return T @ middle


PLACES = (board_at(0, 0, 0.2, 0.1), board_at(0.03, -0.03, -0.4, -0.2), board_at(-0.04, 0.04, 0.4, 0.2))


def picture(K: Intrinsics, T_camera_board: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the image of a board: blurred by the lens, with the noise of a sensor."""
    texture = np.where(BOARD.modules, 25, 230).astype(np.uint8).repeat(TEXTURE_PX, 0).repeat(TEXTURE_PX, 1)
    texture = np.pad(texture, TEXTURE_PX, constant_values=230)
    texel_m = BOARD.square_m / 10 / TEXTURE_PX
    board_texture = np.array(
        [[texel_m, 0, (0.5 - TEXTURE_PX) * texel_m], [0, texel_m, (0.5 - TEXTURE_PX) * texel_m], [0, 0, 1]]
    )
    project = np.array([[K.fx, 0, K.cx], [0, K.fy, K.cy], [0, 0, 1]]) @ T_camera_board[:3][:, [0, 1, 3]]
    fine = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1]])
    size = K.width * FINE, K.height * FINE
    drawn = cv2.warpPerspective(texture, fine @ project @ board_texture, size, flags=cv2.INTER_AREA, borderValue=110)
    small = cv2.GaussianBlur(cv2.resize(drawn, (K.width, K.height), interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    noisy = small[..., None] + rng.normal(0, 4, (K.height, K.width, 3))
    return np.clip(noisy, 0, 255).astype(np.uint8)


def write_board_recording(path: Path, K: Intrinsics, T_world_camera: np.ndarray, late_s: float) -> Path:
    """Write a recording of a board that lies still at three places, 15 frames a second, with a floor as depth."""
    rng = np.random.default_rng(K.width + round(1000 * late_s))
    rays = np.stack([*np.meshgrid(np.arange(K.width), np.arange(K.height))], -1)
    directions = np.dstack([(rays[..., 0] - K.cx) / K.fx, (rays[..., 1] - K.cy) / K.fy, np.ones(rays.shape[:2])])
    floor_m = -T_world_camera[2, 3] / (directions @ T_world_camera[2, :3])
    frames = []
    for k in range(9):
        color = picture(K, inverse(T_world_camera) @ PLACES[k // 3], rng)[..., ::-1]
        depth_m = floor_m + rng.normal(0, 1e-3, floor_m.shape) * floor_m**2
        frames.append(Frame(k, k // 3 + (k % 3) / 15 + late_s, color, depth_m.astype(np.float32), None))
    return write_plain(path, K, frames)


def test_a_board_gives_the_poses_within_a_millimetre(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = [
        str(write_board_recording(tmp_path / name, K, T, late_s))
        for name, K, T, late_s in zip(("a", "b"), CAMERAS, POSES, (0.0, 0.021), strict=True)
    ]
    output = tmp_path / "rig.json"
    assert main(["calibrate", "--rig", *paths, "--board", "--output", str(output), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)["cameras"][1]
    found = open_recording(output)
    assert isinstance(found, RigRecording)
    error = inverse(inverse(POSES[0]) @ POSES[1]) @ found.rig.T_rig_camera["b"]
    error_mm, error_degrees = 1000 * np.linalg.norm(error[:3, 3]), np.degrees(angle(error))
    assert error_mm < 1.0
    assert error_degrees < 0.1
    assert printed["board_positions"] >= 3
    assert error_mm < 4 * printed["error_mm"] < 4.0
    assert error_degrees < 4 * printed["error_degrees"] < 0.4
    assert output.with_suffix(".png").is_file()


def test_a_camera_without_depth_is_left_out_of_the_picture_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b"):
        times_s = np.arange(3) / 30
        write_camera(tmp_path / name, WIDE, [RIG_POSES[name == "b"]] * 3, times_s)
    for file in (tmp_path / "a" / "depth").iterdir():
        cv2.imwrite(str(file), np.zeros((WIDE.height, WIDE.width), np.uint16))
    fit = BoardFit(np.array(RIG_POSES), np.zeros(2), np.zeros(2), np.array([3, 3]), 0.1)
    monkeypatch.setattr("cuboid.runs.pipeline.rig_calibrating.calibrate_with_board", lambda *_: fit)
    output = tmp_path / "rig.json"
    call = ["calibrate", "--rig", str(tmp_path / "a"), str(tmp_path / "b"), "--output", str(output), "--board"]
    assert main(call) == 0
    assert re.search(r"^cuboid: warning: not in the picture: .*camera a: ", capsys.readouterr().err, re.M)
    assert isinstance(open_recording(output), RigRecording)
    picture = cv2.imread(str(output.with_suffix(".png")))
    assert picture.shape == (WIDE.height, WIDE.width, 3)
    assert (picture != picture[0, 0]).any(-1).mean() > 0.2  # camera b, in its own view


def seen_by(k: int, times_s: np.ndarray, T_world_board: np.ndarray, rng: np.random.Generator) -> list[BoardSeen]:
    points = BOARD.corners @ T_world_board[:3, :3].T + T_world_board[:3, 3]
    T = inverse(POSES[k])
    pixels = CAMERAS[k].pixels(points @ T[:3, :3].T + T[:3, 3])
    numbers = np.arange(len(points))
    return [BoardSeen(float(t), numbers, pixels + rng.normal(0, 0.05, pixels.shape)) for t in times_s]


def test_a_board_counts_only_while_it_stands_still() -> None:
    rng, still, times = np.random.default_rng(0), PLACES[1], np.arange(5) / 10
    seen = [seen_by(k, times, still, rng) for k in range(2)]
    for j in range(6):  # carried through the view: the cameras, which take turns, see it at other places
        for k in range(2):
            carried = board_at(0.02 * (2 * j + k), 0.0, 0.1, 0.1)
            seen[k] += seen_by(k, np.array([0.6 + 0.1 * j + 0.05 * k]), carried, rng)
    fit = fit_board(seen, CAMERAS, ("a", "b"), BOARD)
    error = inverse(inverse(POSES[0]) @ POSES[1]) @ fit.T_rig_camera[1]
    assert fit.positions.tolist() == [1, 1]
    assert 1000 * np.linalg.norm(error[:3, 3]) < 1.0


def test_a_camera_without_the_board_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_board_recording(tmp_path / "a", CAMERAS[0], POSES[0], 0.0)
    call = ["calibrate", "--rig", str(path), str(path), "--output", str(tmp_path / "rig.json"), "--board", "9x6x20mm"]
    assert main(call) == 2
    assert "no frame shows the board 9x6x20mm; --board has the size of another board" in capsys.readouterr().err


def test_markers_of_another_board_alone_are_no_view() -> None:
    board = Board(3, 3)
    later = np.arange(100, 100 + len(board._charuco.getIds()))  # ids of another board
    drawn = cv2.aruco.CharucoBoard((3, 3), 0.038, 0.6 * 0.038, cv2.aruco.getPredefinedDictionary(DICTIONARY), later)
    image = np.full((400, 400), 255, np.uint8)
    image[50:350, 50:350] = drawn.generateImage((300, 300))
    numbers, pixels = board.find(np.dstack([image] * 3))
    assert len(numbers) == len(pixels) == 0


def test_the_printed_board_has_its_true_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "board.pdf"
    assert main(["calibrate", "--print-board", str(file)]) == 0
    assert "--board 7x5x38mm --output rig.json" in capsys.readouterr().out
    content = file.read_bytes().decode("latin-1")
    assert content.startswith("%PDF-")
    assert re.search(r"/MediaBox \[0 0 841\.\d+ 595\.\d+\]", content)  # A4 in points
    dots_per_mm, points_per_mm = 10, 72 / 25.4
    page = np.full((2100, 2970), 255, np.uint8)
    for x, y, width, height in re.findall(r"^(\S+) (\S+) (\S+) (\S+) re f$", content, re.M):
        left, low, right, high = (
            round(value / points_per_mm * dots_per_mm)
            for value in (float(x), float(y), float(x) + float(width), float(y) + float(height))
        )
        page[2100 - high : 2100 - low, left:right] = 0
    numbers, pixels = BOARD.find(np.dstack([page] * 3))
    assert len(numbers) == len(BOARD.corners)
    apart_mm = np.linalg.norm(pixels[-1] - pixels[0]) / dots_per_mm
    assert apart_mm == pytest.approx(1000 * np.linalg.norm(BOARD.corners[-1] - BOARD.corners[0]), abs=0.1)
    start = int(re.search(r"startxref\n(\d+)", content).group(1))
    assert content[start:].startswith("xref")


def test_wrong_calls_of_a_board_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, part in (
        (["--board", "--output", "x.json"], "name their recordings with --rig"),
        (["--print-board", "x.png"], "must be a .pdf file"),
        (["--print-board", "x.pdf", "--board", "9x7x200mm"], "larger than A0"),
        (["--output", "x.txt"], "must be a .json file"),
        (["recording"], "name the file to write with --output"),
    ):
        assert main(["calibrate", *words]) == 2
        assert part in capsys.readouterr().err
    with pytest.raises(ValueError, match="expected COLUMNSxROWSxSIDEmm"):
        board_of("7x5")
    assert board_of(str(BOARD)) == BOARD
    assert board_pdf(Board(10, 7, 0.05)).startswith(b"%PDF")  # on A2
