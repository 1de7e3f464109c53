"""`cuboid measure --camera`: a steady answer after two seconds, one line an object, and the camera is closed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from played import PlayedDriver

from cuboid.cli import main
from cuboid.inputs.cameras import LiveCamera, Shot
from cuboid.inputs.readers import Calibration
from made_parcels import SIDES_M, UNITS_PER_M, write_parcels
from made_scenes import CAMERA

RATE_HZ = 10
CALIBRATION = Calibration(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, (CAMERA.width, CAMERA.height), "the fake")


class ParcelCamera(PlayedDriver):
    """Looks at the parcels without end, without poses; each frame waits for the tracker, so that none is dropped."""

    depth_units_per_metre = float(UNITS_PER_M)

    def __init__(self, folder: Path) -> None:
        super().__init__(0, calibration=CALIBRATION, poses=False)
        color, depth = (sorted((folder / name).iterdir()) for name in ("color", "depth"))
        self._colors = [cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB) for path in color]
        self._depths = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in depth]

    def take(self, wait_s: float) -> Shot:
        k, self.taken = self.taken, self.taken + 1
        shown = k % len(self._colors)
        return Shot(100.0 + k / RATE_HZ, self._colors[shown], self._depths[shown], None)


@dataclass
class Cameras:
    """Opens the camera that looks at the parcels, and remembers the last one."""

    folder: Path
    opened: ParcelCamera | None = None

    def open(self, *_: object, **__: object) -> LiveCamera:
        self.opened = ParcelCamera(self.folder)
        return LiveCamera(self.opened)


@pytest.fixture
def cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cameras:
    write_parcels(tmp_path / "parcels")
    made = Cameras(tmp_path / "parcels")
    monkeypatch.setattr("cuboid.inputs.cameras.open_camera", made.open)
    return made


def test_after_two_seconds_the_answer_is_steady_with_a_line_for_each_object(
    cameras: Cameras, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "dimensions.png"
    assert main(["measure", "--camera", "toy", "--picture", str(picture)]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert [line[:4] for line in lines] == ["#1: ", "#2: ", "#3: ", "the "]
    assert cv2.imread(str(picture)).shape[:2] == (CAMERA.height, CAMERA.width)
    assert cameras.opened is not None
    assert cameras.opened.closed == 1

    assert main(["measure", "--camera", "toy", "--seconds", "1", "--json"]) == 0
    early = json.loads(capfd.readouterr().out)
    assert early["frames"] == RATE_HZ + 1
    after_1_s = np.array([one["size_m"] for one in early["objects"]])
    after_2_s = np.array([[float(word) for word in line[4:].split(" mm ")[0].split(" x ")] for line in lines[:3]]) / 1e3
    np.testing.assert_allclose(after_2_s, after_1_s, atol=0.001)
    np.testing.assert_allclose(sorted(after_2_s.tolist()), sorted(map(list, SIDES_M)), atol=0.004)


def test_an_option_of_recordings_is_refused(cameras: Cameras, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", "--camera", "toy", "--depth-scale", "1000"]) == 2
    assert "--depth-scale is for recordings only; a camera provides this value" in capfd.readouterr().err
    assert main(["measure", "recording", "--camera", "toy"]) == 2
    assert "a run has one source: either the recording recording or --camera toy" in capfd.readouterr().err
    assert cameras.opened is None
