"""The command that writes the way of a camera."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from posed_pictures import CAMERA, ate_m, black, camera_path, picture

from cuboid.cli import main
from cuboid.results.files import read_run, read_trajectory

FRAMES = 24
COVERED = (12, 13)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of color and depth images with one line of intrinsics."""
    folder = tmp_path_factory.mktemp("plain")
    for name in ("color", "depth"):
        (folder / name).mkdir()
    for k, T in enumerate(camera_path(FRAMES, 30.0)):
        frame = black(k) if k in COVERED else picture(T, k)
        cv2.imwrite(str(folder / "color" / f"{k:06d}.png"), frame.color[..., ::-1])
        cv2.imwrite(
            str(folder / "depth" / f"{k:06d}.png"),
            np.rint(np.where(frame.depth_m > 0, frame.depth_m, 0.4) * 1000).astype(np.uint16),
        )
    return folder


def call(recording: Path, output: Path, *more: str) -> int:
    camera = f"{CAMERA.fx},{CAMERA.fy},{CAMERA.cx},{CAMERA.cy}"
    return main(
        ["slam", str(recording), "--output", str(output), "--intrinsics", camera, "--depth-scale", "1000", *more]
    )


def test_it_writes_the_way_of_the_camera(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(recording, tmp_path / "out") == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "22 of 24 frames tracked, 2 lost," in shown
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "run.json",
        "trajectory.txt",
        "trajectory_online.txt",
    ]
    final = read_trajectory(tmp_path / "out" / "trajectory.txt")
    online = read_trajectory(tmp_path / "out" / "trajectory_online.txt")
    there = [k for k in range(FRAMES) if k not in COVERED]
    np.testing.assert_allclose([row.timestamp_s for row in final], np.array(there) / 30, atol=1e-5)
    assert len(online) == len(there)
    true = camera_path(FRAMES, 30.0)
    for rows in (final, online):
        assert ate_m([row.T_world_camera for row in rows], [true[k] for k in there]) < 0.006
    report = read_run(tmp_path / "out" / "run.json")
    assert report.complete
    assert report.poses == "estimated"
    assert [frame for frame, _ in report.skipped] == list(COVERED)
    assert report.skipped[0][1].startswith("the camera is lost")
    assert report.milliseconds["poses"].median_ms > 0


def test_two_runs_write_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert call(recording, tmp_path / name, "--limit", "10", "--threads", "1") == 0
    for file in ("trajectory.txt", "trajectory_online.txt"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_results_are_not_replaced_unasked(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").mkdir()
    assert call(recording, tmp_path / "out", "--limit", "2") == 2
    assert "the output folder exists; --force replaces the results in it" in capsys.readouterr().err
    assert call(recording, tmp_path / "out", "--limit", "2", "--force", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["run"] == json.loads((tmp_path / "out" / "run.json").read_text())
    assert {name: printed[name] for name in ("output", "lost", "loops")} == {
        "output": str(tmp_path / "out"),
        "lost": 0,
        "loops": 0,
    }


def test_a_recording_in_the_dark_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("color", "depth"):
        (tmp_path / "dark" / name).mkdir(parents=True)
    for k in range(3):
        frame = black(k)
        cv2.imwrite(str(tmp_path / "dark" / "color" / f"{k}.png"), frame.color)
        cv2.imwrite(str(tmp_path / "dark" / "depth" / f"{k}.png"), np.ones((240, 320), np.uint16))
    assert call(tmp_path / "dark", tmp_path / "out") == 2
    assert "no frame has enough depth and texture to start with" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
