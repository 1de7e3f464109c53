"""The whole way, command line to files, on a real recording: what the contract says of the files holds."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from called import called
from cuboid.results.files import (
    read_map,
    read_objects,
    read_proposals,
    read_run,
    read_tracks,
    read_trajectory,
)

EVERY, FRAMES = 40, 23


def cuboid(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "cuboid", *map(str, words)], capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def results(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("real") / "out"
    scene = data_dir / "rgbd-scenes-v2" / "imgs" / "scene_01"
    done = cuboid("track", scene, "--output", output, "--every", str(EVERY), "--threads", "1")
    assert done.returncode == 0, done.stderr
    assert f"{FRAMES} of {FRAMES} frames" in done.stdout
    return output


def test_every_file_is_what_the_contract_says(results: Path) -> None:
    objects = read_objects(results / "objects.json")
    labels = [item.label for item in objects.objects]
    assert labels
    assert labels == sorted(set(labels))
    assert objects.up is not None
    assert np.linalg.norm(objects.up) == pytest.approx(1.0)
    for item in objects.objects:
        rotation = item.box.rotation
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-6)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        assert (item.box.size > 0).all()
        assert 0 <= item.score <= 1
        assert 0 <= item.heat <= 1
        assert 0 <= item.first_frame <= item.last_frame < 888
        assert item.first_frame % EVERY == 0
        assert 1 <= item.frames_seen <= FRAMES
        assert item.plane is None or 0 <= item.plane < len(objects.planes)
        assert not set(item.merged_labels) & set(labels)
    known = {*labels, *(old for item in objects.objects for old in item.merged_labels)}
    tracks = read_tracks(results / "tracks.csv")
    assert [row.frame for row in tracks] == sorted(row.frame for row in tracks)
    for row in tracks:
        x0, y0, x1, y1 = row.rect_xyxy
        assert row.frame % EVERY == 0
        assert 0 <= x0 < x1 <= 640
        assert 0 <= y0 < y1 <= 480
        assert row.iou is None or 0 <= row.iou <= 1
        assert 0 <= row.visible <= 1
    assert {row.label for row in tracks} >= set(labels)
    assert {row.label for row in read_proposals(results / "proposals.csv")} & known
    points = read_map(results / "map.ply")
    assert len(points.xyz) > 1000
    assert np.isfinite(points.xyz).all()
    assert 0 <= points.heat.min() <= points.heat.max() <= 1
    assert set(np.unique(points.label)) <= {0, *labels}
    for item in objects.objects:
        assert (points.label == item.label).sum() == item.points


def test_the_trajectory_is_the_given_one(results: Path, data_dir: Path) -> None:
    given = np.loadtxt(data_dir / "rgbd-scenes-v2" / "pc" / "01.pose")[::EVERY]
    rows = read_trajectory(results / "trajectory.txt")
    assert len(rows) == len(given)
    np.testing.assert_allclose([row.T_world_camera[:3, 3] for row in rows], given[:, 4:], atol=1e-5)
    assert rows[1].timestamp_s == pytest.approx(EVERY / 30, abs=1e-6)


def test_how_it_went(results: Path) -> None:
    run = read_run(results / "run.json")
    assert (run.frames_read, run.frames_used, run.skipped) == (FRAMES, FRAMES, ())
    assert run.complete
    assert list(run.milliseconds)[:2] == ["frame", "decode"]
    stages = sum(timing.median_ms for stage, timing in run.milliseconds.items() if stage != "frame")
    assert stages <= 1.3 * run.milliseconds["frame"].median_ms
    assert 50 < run.peak_memory_mb < 1000


def test_the_same_input_gives_the_same_bytes(results: Path, data_dir: Path, tmp_path: Path) -> None:
    scene = data_dir / "rgbd-scenes-v2"
    done = cuboid("track", scene, "--output", tmp_path / "out", "--every", str(EVERY), "--threads", "2")
    assert done.returncode == 0, done.stderr
    for name in ("objects.json", "tracks.csv", "proposals.csv", "trajectory.txt", "map.ply"):
        assert (tmp_path / "out" / name).read_bytes() == (results / name).read_bytes(), name


def test_faults_in_a_real_recording_are_skipped_with_their_reasons(data_dir: Path, tmp_path: Path) -> None:
    source = data_dir / "rgbd-scenes-v2"
    images = tmp_path / "scenes" / "imgs" / "scene_01"
    images.mkdir(parents=True)
    (tmp_path / "scenes" / "pc").mkdir()
    lines = (source / "pc" / "01.pose").read_text().splitlines()[:12]
    lines[7] = "nan 0 0 0 0 0 0"
    (tmp_path / "scenes" / "pc" / "01.pose").write_text("\n".join(lines[:11]) + "\n")
    for i in range(12):
        for kind in ("color.jpg", "depth.png"):
            shutil.copy(source / "imgs" / "scene_01" / f"{i:05d}-{kind}", images)
    color = images / "00003-color.jpg"
    color.write_bytes(color.read_bytes()[:5000])
    (images / "00005-depth.png").write_bytes(b"")
    done = called("track", tmp_path / "scenes", "--output", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "4 of 12 frames skipped:" in done.stdout
    skipped = dict(read_run(tmp_path / "out" / "run.json").skipped)
    assert sorted(skipped) == [3, 5, 7, 11]
    assert all(name in skipped[frame] for frame, name in ((3, "00003-color.jpg"), (5, "00005-depth.png")))
    assert all(reason in done.stdout for reason in skipped.values())


def test_a_wrong_depth_scale_is_said(data_dir: Path, tmp_path: Path) -> None:
    scene = data_dir / "rgbd-scenes-v2"
    done = called("track", scene, "--output", tmp_path / "out", "--limit", "5", "--depth-scale", "1")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "0.1 and 20 m" in done.stderr
    assert "--depth-scale" in done.stderr
    assert not (tmp_path / "out").exists()
