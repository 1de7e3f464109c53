"""Whoever takes a path takes it as a text and as a path."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import trimesh

import cuboid
from cuboid.ground.core.paths import PathLike
from cuboid.inputs.recordings.converting import convert_recording
from cuboid.lab.annotation import KeyframesFile
from cuboid.lab.evaluation import evaluate, evaluate_keyframes, read_keyframes, read_result, read_truth
from cuboid.lab.evaluation.timed_poses import read_poses
from cuboid.lab.evaluation.trajectory import evaluate_trajectory
from cuboid.lab.evaluation.visits import evaluate_visits
from cuboid.lab.synthetic import make_scene, make_visits, render_recording, render_visits
from cuboid.lab.synthetic.user_meshes import load_meshes
from cuboid.results.exports import export
from cuboid.results.files import Results, ResultWriter
from cuboid.results.views.replay import Replay
from cuboid.results.views.report import summarise, write_report
from cuboid.runs.pipeline.slam import estimate_trajectory
from cuboid.runs.scene.running import IntoScene
from fakes import FakeTracker, write_recording
from made_results import write_results

# What a user reaches: the packages whose names are public. Others make these two.
PUBLIC = (
    *("cuboid", "cuboid.inputs.cameras", "cuboid.method.poses", "cuboid.results.exports", "cuboid.runs.scene"),
    *("cuboid.lab.evaluation", "cuboid.lab.synthetic"),
)
MADE_BY_OTHERS = {"Recording", "SceneTracker"}

Name = Callable[[Path], PathLike]


@pytest.fixture(params=[str, Path], ids=["text", "path"])
def name(request: pytest.FixtureRequest) -> Name:
    made: Name = request.param
    return made


@pytest.fixture
def recording(tmp_path: Path) -> cuboid.Recording:
    return cuboid.open_recording(write_recording(tmp_path / "recording", 4))


def public_calls() -> Iterator[tuple[str, Callable[..., object]]]:
    for package in PUBLIC:
        module = import_module(package)
        for name in cuboid._PLACES if module is cuboid else module.__all__:
            value = getattr(module, name)
            if inspect.isfunction(value):
                yield f"{package}.{name}", value
            elif inspect.isclass(value) and name not in MADE_BY_OTHERS:
                for method, call in inspect.getmembers(value, callable):
                    if method == "__init__" and is_dataclass(value):
                        continue
                    if inspect.isroutine(call) and (method == "__init__" or not method.startswith("_")):
                        yield f"{package}.{name}.{method}", call


def test_no_public_call_wants_a_path_alone() -> None:
    narrow: list[str] = []
    seen = 0
    for name, call in public_calls():
        for parameter, kind in getattr(call, "__annotations__", {}).items():
            if parameter != "return" and isinstance(kind, str):
                seen += "PathLike" in kind
                narrow += [f"{name}: {parameter}"] if re.search(r"\bPath\b", kind) else []
    assert narrow == []
    assert seen > 12


def test_a_run_and_its_results(name: Name, recording: cuboid.Recording, tmp_path: Path) -> None:
    out = tmp_path / "results"
    cuboid.track_recording(
        cuboid.open_recording(name(recording.path)), name(out), hooks=cuboid.RunHooks(make_tracker=FakeTracker)
    )
    assert (out / "report.html").is_file()
    finished = Results(name(out))
    assert finished.report.frames_used == 4
    assert len(Replay(name(out), name(recording.path)).recording) == 4
    assert len(cuboid.open_results(name(out), name(recording.path)).recording) == 4
    write_report(name(tmp_path / "page.html"), summarise(finished, recording.read))
    assert (tmp_path / "page.html").is_file()
    with pytest.raises(cuboid.CuboidError, match="exists"):
        ResultWriter(name(out))


def test_what_a_tracker_saves(name: Name, recording: cuboid.Recording, tmp_path: Path) -> None:
    tracker = cuboid.Tracker(recording.intrinsics)
    for frame in recording:
        tracker.update(frame)
    tracker.save(name(tmp_path / "results"), recording=recording)
    assert (tmp_path / "results" / "run.json").is_file()


def test_a_recording_in_another_form(name: Name, recording: cuboid.Recording, tmp_path: Path) -> None:
    convert_recording(recording, name(tmp_path / "plain"), "plain", range(2))
    assert len(cuboid.open_recording(name(tmp_path / "plain"), intrinsics=name(recording.path / "camera.json"))) == 2
    KeyframesFile(name(tmp_path / "keyframes.json"), recording)


def test_exports(name: Name, tmp_path: Path) -> None:
    out = write_results(tmp_path)
    run = Results(name(out), name(tmp_path / "recording"))
    assert len(run.recording) == 40
    export(run, "csv", name(tmp_path / "objects.csv"))
    assert (tmp_path / "objects.csv").is_file()


def test_a_scene(name: Name, recording: cuboid.Recording, tmp_path: Path) -> None:
    file = tmp_path / "place.cuboid"
    cuboid.track_recording(
        recording, name(tmp_path / "results"), results=cuboid.ResultOptions(page=False), into=IntoScene(name(file))
    )
    with cuboid.Scene.open(name(file)) as scene:
        assert len(scene.recordings) == 1
        scene.write_results(name(tmp_path / "again"))
    with cuboid.Scene(name(file)) as scene:
        assert len(scene.recordings) == 1
    assert (tmp_path / "again" / "objects.json").is_file()


def test_a_made_recording_and_what_judges_it(name: Name, tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "meshes" / "cube.ply")
    scene = make_scene("table", seed=1, frames=12, meshes=load_meshes(name(tmp_path / "meshes")))
    render_recording(scene, name(tmp_path / "made"), size=(160, 120), sensor="clean")
    cuboid.track_recording(
        cuboid.open_recording(tmp_path / "made"), name(tmp_path / "results"), results=cuboid.ResultOptions(page=False)
    )
    result, truth = name(tmp_path / "results"), name(tmp_path / "made")
    cloud, path = name(tmp_path / "made" / "true_cloud.ply"), name(tmp_path / "made" / "true_trajectory.txt")
    found = evaluate(result, truth, cloud=cloud, trajectory=path)
    assert found.heat is not None
    assert read_result(result).map_points == tmp_path / "results" / "map.ply"
    assert len(read_truth(truth).objects) == len(scene.objects)
    assert len(read_poses(path).times_s) == 12
    assert evaluate_trajectory(result, path).pairs == 12


def test_keyframes(name: Name, tmp_path: Path) -> None:
    file = tmp_path / "keyframes.json"
    drawn = {"id": 1, "rect": [0, 0, 9, 9]}
    document = {"format": "cuboid-keyframes", "version": 1, "objects": [{"id": 1, "name": "mug"}]}
    file.write_text(json.dumps({**document, "frames": [{"frame": 5, "boxes": [drawn]}]}))
    assert len(read_keyframes(name(file)).frames) == 1
    found = evaluate_keyframes(name(write_results(tmp_path)), name(file), name(tmp_path / "recording"))
    assert found.keyframes == str(file)


def test_visits(name: Name, tmp_path: Path) -> None:
    visits = make_visits("table", 1, 2, frames=8)
    render_visits(visits, name(tmp_path / "place"), size=(160, 120), sensor="clean")
    into = IntoScene(name(tmp_path / "place.cuboid"), same_world=True)
    for number in (1, 2):
        taken = cuboid.open_recording(tmp_path / "place" / f"visit-{number}")
        cuboid.track_recording(taken, None, into=into)
    evaluate_visits(name(tmp_path / "place.cuboid"), name(tmp_path / "place"))


def test_poses_alone(name: Name, tmp_path: Path) -> None:
    render_recording(make_scene("table", seed=1, frames=4), tmp_path / "made", size=(160, 120), sensor="clean")
    estimate_trajectory(cuboid.open_recording(tmp_path / "made"), name(tmp_path / "poses"))
    assert np.loadtxt(tmp_path / "poses" / "trajectory.txt").shape == (4, 8)
