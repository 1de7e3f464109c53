"""Relations of a scene's objects: kept for the recordings at whose end they held."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from made_scene import CAMERA, THINGS, Shown

from cuboid import cli
from cuboid.ground.core.errors import InputError
from cuboid.method.relations import find_walls
from cuboid.runs.scene import Scene
from cuboid.runs.scene.database import Writing, transaction
from cuboid.runs.scene.relations import PLANE, WALL, write_relations
from made_scenes import upright


def recorded(path: Path, shown: Shown, *, related: bool = True) -> None:
    with Scene.open(path) as scene, scene.tracker(CAMERA, proposals=shown.proposals) as tracker:
        for frame in shown.frames:
            tracker.update(frame)
        tracker.close(walls=find_walls(tracker.map_points(), tracker.up) if related else None)


def kept(scene: Scene, label: int) -> list[tuple[object, ...]]:
    return [(one.kind, one.to, one.first_recording, one.last_recording) for one in scene.relation_history(label)]


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two things side by side; in the second visit one of them stands far away."""
    path = tmp_path_factory.mktemp("related") / "place.cuboid"
    near = upright((0.0, 0.14), (0.12, 0.12, 0.2), 0.0, z=0.48)
    far = upright((0.45, -0.1), (0.12, 0.12, 0.2), 0.0, z=0.48)
    recorded(path, Shown((THINGS[0], near), frames=40))
    recorded(path, Shown((THINGS[0], far), frames=60, begin=0.4))
    return path


def test_a_relation_lasts_from_the_recording_that_shows_it_to_the_last_one(moved: Path) -> None:
    with Scene.open(moved) as scene:
        one, two = (item.label for item in scene.objects)
        (plane,) = {item.plane for item in scene.objects}
        assert kept(scene, one) == [("on", f"plane:{plane}", 1, 2), ("beside", two, 1, 1)]
        assert kept(scene, two) == [("on", f"plane:{plane}", 1, 2), ("beside", one, 1, 1)]
        assert all(0.5 <= past.score <= 1.0 for past in scene.relation_history(one))
        assert not any(past.kind == "beside" for past in scene.relations[one]), "now it holds no more"
        with pytest.raises(InputError, match="no object has the label 9"):
            scene.relation_history(9)


def test_the_command_shows_them(moved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scene", "show", str(moved), "1"]) == 0
    shown = capsys.readouterr().out
    assert "beside #2, recordings 1 to 1" in shown
    assert cli.main(["scene", "show", str(moved), "1", "--json"]) == 0
    first, *_, last = json.loads(capsys.readouterr().out)["relations"]
    assert (first["is"], first["first_recording"], first["last_recording"]) == ("on", 1, 2)
    assert (last["is"], last["to"], last["last_recording"]) == ("beside", 2, 1)


def test_recordings_without_relations_note_none(tmp_path: Path) -> None:
    recorded(tmp_path / "s.cuboid", Shown(), related=False)
    with Scene.open(tmp_path / "s.cuboid") as scene:
        assert scene.relation_history(1) == []
        assert {one.kind for one in scene.relations[1]} >= {"on"}, "they are found when they are asked for"


def test_a_relation_that_came_back_has_two_times(moved: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.cuboid"
    path.write_bytes(moved.read_bytes())
    file = Writing(path)
    with transaction(file.connection):
        for recording, held in ((3, "beside"), (5, "beside"), (6, "under")):
            write_relations(file.connection, recording, {(1, held, "2"): 0.9, (1, "on", f"{PLANE}77"): 1.0})  # type: ignore[dict-item]
        write_relations(file.connection, 7, {(1, "against", WALL): 0.8})
    file.close()
    with Scene.open(path) as scene:
        found = kept(scene, 1)
    assert ("beside", 2, 1, 1) in found
    assert ("beside", 2, 3, 5) in found
    assert ("under", 2, 6, 6) in found
    assert ("on", "plane", 3, 6) in found, "a plane that is no longer known has no number"
    assert ("against", "wall", 7, 7) in found


def test_a_damaged_row_is_named(moved: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.cuboid"
    path.write_bytes(moved.read_bytes())
    file = Writing(path)
    file.connection.execute("UPDATE relations SET target = 'one' WHERE kind = 'on'")
    file.close()
    with Scene.open(path) as scene, pytest.raises(InputError, match=r"relations\.target is damaged"):
        scene.relation_history(1)
