"""A scene keeps what happened to its objects while recordings watched them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_scene import change

from cuboid import cli
from cuboid.ground.core.errors import InputError
from cuboid.runs.scene import Scene
from cuboid.runs.scene.checking import problems, rescue
from made_scenes import CAMERA, frame_of, look_at, upright

FLOOR = upright((0.0, 0.0), (6.0, 6.0, 0.02), z=-0.72)
TABLE = upright((0.0, 0.0), (1.2, 0.8, 0.7), z=-0.7)
STANDING = look_at((0.0, -1.1, 0.8), (0.0, 0.0, 0.0))
SIZE, STEP_M = (0.12, 0.12, 0.15), 0.03
FROM, TO = np.array([-0.42, 0.0, 0.0]), np.array([0.3, 0.0, 0.0])
UP = np.array([0.0, 0.0, 0.25])


def places() -> list[np.ndarray]:
    """A box stands, is carried over the table, and stands again."""
    found = [FROM] * 75
    for a, b in ((FROM, FROM + UP), (FROM + UP, TO + UP), (TO + UP, TO)):
        found += [a + part * (b - a) for part in np.linspace(0, 1, 2 + int(np.linalg.norm(b - a) / STEP_M))[1:]]
    return [*found, *[TO] * 30]


def test_a_scene_tells_when_an_object_was_moved_and_from_where(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "table.cuboid"
    with Scene.open(path) as scene:
        assert scene.events() == []
    for moved in (True, False):
        with Scene.open(path) as scene, scene.tracker(CAMERA) as tracker:
            for k, place in enumerate(places() if moved else [TO] * 20):
                box = upright((float(place[0]), float(place[1])), SIZE, z=float(place[2]))
                tracker.update(frame_of([FLOOR, TABLE, box], STANDING, k))
    with Scene.open(path) as scene:
        (item,) = scene.objects
        (event,) = scene.events(item.label)
        assert [one.frame for one in scene.events()] == [event.frame]
        assert (event.event, event.label, event.recording) == ("moved", item.label, 1)
        assert event.frame > 75
        assert event.time_s == pytest.approx(event.frame / 30)
        assert event.from_m is not None
        assert event.to_m is not None
        np.testing.assert_allclose(event.from_m[:2], FROM[:2], atol=0.03)
        np.testing.assert_allclose(event.to_m[:2], TO[:2], atol=0.03)
        with pytest.raises(InputError, match="no object has the label 9"):
            scene.events(9)
    assert problems(path) == []
    rescued = tmp_path / "rescued.cuboid"
    assert rescue(path, rescued) == []
    with Scene.open(rescued) as scene:
        assert [(one.event, one.frame) for one in scene.events(item.label)] == [("moved", event.frame)]
    assert cli.main(["scene", "show", str(path), str(item.label), "--json"]) == 0
    (shown,) = json.loads(capsys.readouterr().out)["events"]
    assert (shown["event"], shown["recording"], shown["frame"]) == ("moved", 1, event.frame)
    change(path, "DELETE FROM frames WHERE frame = ?", event.frame)
    rescue(path, tmp_path / "again.cuboid")
    with Scene.open(tmp_path / "again.cuboid") as scene:
        assert scene.events() == []  # its frame is lost
