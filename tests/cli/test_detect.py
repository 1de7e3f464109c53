"""`cuboid detect` and `cuboid.detect`: the objects of one picture."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import cuboid
from cuboid.cli import main
from cuboid.cli.detect import ADVICE
from cuboid.inputs.recordings.picture import open_picture
from made_scenes import CAMERA, frame_of, look_at, upright

THINGS = [upright((-0.3, 0.0), (0.2, 0.12, 0.1), 0.4), upright((0.15, 0.15), (0.1, 0.1, 0.18))]
SCENE = [upright((0, 0), (1.6, 1.2, 0.05), z=-0.05), *THINGS]
UNITS = 10000
PINHOLE = f"{CAMERA.fx},{CAMERA.fy},{CAMERA.cx},{CAMERA.cy}"


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("detect")
    frame = frame_of(SCENE, look_at((0.0, -1.0, 0.8), (0, 0, 0)), 0)
    (folder / "color").mkdir()
    (folder / "depth").mkdir()
    color, depth = folder / "color" / "table.png", folder / "depth" / "table.png"
    cv2.imwrite(str(color), frame.color[..., ::-1])
    cv2.imwrite(str(depth), np.rint(frame.depth_m * UNITS).astype(np.uint16))
    return color, depth


def test_the_command_and_the_function_find_the_same_objects(
    images: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    color, depth = images
    words = ["detect", *map(str, images), "--intrinsics", PINHOLE, "--depth-scale", str(UNITS)]
    assert main([*words, "-o", str(tmp_path / "out")]) == 0
    assert ADVICE in " ".join(capsys.readouterr().out.split())
    written = json.loads((tmp_path / "out" / "objects.json").read_text(encoding="utf-8"))["objects"]
    frame = open_picture(color, depth, intrinsics=(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy), depth_scale=UNITS)[0]
    found = cuboid.detect(frame.color, frame.depth_m, CAMERA)
    assert len(found) == len(THINGS)
    for one, other in zip(written, found, strict=True):
        assert one["label"] == other.label
        assert one["probability"] == pytest.approx(other.probability, abs=1e-6)
        np.testing.assert_allclose(one["center"], other.box.center, atol=2e-6)
    picture = cv2.imread(str(tmp_path / "out" / "labelled.png"))
    assert picture.shape == frame.color.shape
    assert np.count_nonzero(np.abs(picture.astype(int) - frame.color[..., ::-1]).max(2) > 60) > 500
    assert (tmp_path / "out" / "report.html").is_file()


def test_boxes_are_in_the_world_of_a_given_pose() -> None:
    frame = frame_of(SCENE, look_at((0.0, -1.0, 0.8), (0, 0, 0)), 0)
    found = cuboid.detect(frame.color, frame.depth_m, CAMERA, T_world_camera=frame.T_world_camera)
    assert len(found) == len(THINGS)
    for thing in THINGS:
        assert min(np.linalg.norm(one.box.center - thing.center) for one in found) < 0.03


def test_a_folder_with_one_picture_will_do_and_its_camera_is_found(
    images: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = images[0].parent.parent
    sides = dict(zip(("fx", "fy", "cx", "cy", "width", "height"), (*CAMERA.pinhole.tolist(), 320, 240), strict=True))
    (folder / "camera.json").write_text(json.dumps({**sides, "depth_units_per_metre": UNITS}), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert main(["detect", str(folder)]) == 0
    assert len(cuboid.open_results(tmp_path / f"{folder.name}-objects").objects) == len(THINGS)


@pytest.mark.parametrize(
    ("missing", "message"), [("depth", "no such file"), ("camera", "the intrinsics and the depth scale are not known")]
)
def test_what_is_missing_is_named(
    images: tuple[Path, Path], missing: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    color, depth = images[0], tmp_path / "none.png" if missing == "depth" else images[1]
    assert main(["detect", str(color), str(depth), "-o", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
