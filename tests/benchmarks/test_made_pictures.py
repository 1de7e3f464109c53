"""Made pictures with masks; without the packages of meshes these tests are skipped."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "pictures" / "picture_scenes.py"
# A plain table, the fastest scene.
NUMBER = 9

pytestmark = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("mujoco", "robosuite")),
    reason="needs mujoco and benchmarks/pictures/requirements.txt",
)


def _make(folder: Path) -> dict[str, bytes]:
    command = [sys.executable, str(SCRIPT), "--scenes", f"{NUMBER}-{NUMBER}", "--views", "1", "--out", str(folder)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return {f.name: f.read_bytes() for f in (folder / f"scene-{NUMBER:05d}").iterdir()}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return _make(tmp_path_factory.mktemp("pictures"))


def test_the_number_of_a_scene_decides_its_files(files: dict[str, bytes], tmp_path: Path) -> None:
    assert set(files) == {"color-0.jpg", "depth-0.png", "mask-0.png", "camera.json"}
    assert files == _make(tmp_path)


def test_masks_label_things_that_stand_before_their_surroundings(files: dict[str, bytes]) -> None:
    mask, depth = (
        cv2.imdecode(np.frombuffer(files[name], np.uint8), cv2.IMREAD_UNCHANGED)
        for name in ("mask-0.png", "depth-0.png")
    )
    camera = json.loads(files["camera.json"])
    assert mask.shape == depth.shape == (camera["height"], camera["width"])
    things = [k for k in np.unique(mask) if 0 < k < 65535 and (mask == k).sum() > 500]
    assert things
    for k in things:
        ring = cv2.dilate((mask == k).astype(np.uint8), np.ones((31, 31))) * (mask != k)
        inside, around = depth[(mask == k) & (depth > 0)], depth[(ring > 0) & (depth > 0)]
        assert np.percentile(inside, 20) < np.percentile(around, 80)
