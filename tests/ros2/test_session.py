"""What a node does between two frames: save, reset, name, query, parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cuboid
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.frame import Frame, SkippedFrame
from cuboid.ground.core.results import FrameResult
from cuboid.results.views.ros_stream import StreamSettings
from cuboid.runs.tracking.tracker import Tracker
from cuboid.services.ros2.commands import Cloud, ListParameters, Name, Query, Reset, Save, Set, answer
from cuboid.services.ros2.parameters import Parameters
from cuboid.services.ros2.session import Session
from made_scenes import CAMERA, frame_of, look_at, upright

TABLE = upright((0.0, 0.0), (1.6, 1.6, 0.1), z=-0.1)
BOXES = [TABLE, upright((-0.2, 0.0), (0.12, 0.12, 0.15)), upright((0.2, 0.05), (0.1, 0.14, 0.2))]


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    eyes = [(0.9 * np.cos(a), -0.9 * np.sin(a), 0.7) for a in np.linspace(1.2, 1.9, 12)]
    return [frame_of(BOXES, look_at(eye, (0.0, 0.0, 0.05)), k) for k, eye in enumerate(eyes)]


def session_of(output: Path | None = None, *, force: bool = False) -> Session:
    return Session(lambda: Tracker(CAMERA, poses="given"), output, force=force)


@pytest.fixture
def session(frames: list[Frame], tmp_path: Path) -> Session:
    made = session_of(tmp_path / "out")
    for frame in frames:
        assert isinstance(made.take(frame), FrameResult)
    return made


def test_objects_are_found_by_label_name_and_place(session: Session) -> None:
    first, second = session.query()
    assert [item.label for item in session.query(label=second.label)] == [second.label]
    session.name(first.label, " red mug ")
    assert [item.label for item in session.query(name="MUG")] == [first.label]
    near = tuple(second.box.center)
    assert [item.label for item in session.query(near=near, within_m=10.0)] == [second.label, first.label]
    assert [item.label for item in session.query(near=near, within_m=0.05)] == [second.label]
    assert session.query(near=near, within_m=0.05, name="mug") == []
    session.name(first.label, "")
    assert session.query(name="mug") == []
    for ask in (lambda: session.query(label=99), lambda: session.name(99, "x"), lambda: session.name(1, "a\nb")):
        with pytest.raises(InputError):
            ask()


def test_points_of_an_object_and_of_the_map(session: Session) -> None:
    item = session.query()[0]
    cloud = session.cloud(item.label)
    assert 0 < len(cloud) < len(session.cloud())
    assert np.linalg.norm(cloud.xyz.mean(axis=0) - item.box.center) < 0.1


def test_results_are_saved_with_names_and_saved_again(session: Session, tmp_path: Path) -> None:
    label = session.query()[0].label
    session.name(label, "mug")
    for _ in range(2):  # what it wrote itself it may replace
        assert session.save() == tmp_path / "out"
    results = cuboid.open_results(tmp_path / "out")
    assert {item.label: item.name for item in results.objects}[label] == "mug"
    assert (results.report.frames_used, results.report.skipped) == (12, ())
    assert session.save("monday") == tmp_path / "monday"
    with pytest.raises(OutputError, match="exists"):
        session.save("monday")
    for folder in ("../else", "/tmp/else", ".."):
        with pytest.raises(InputError, match="without a path"):
            session.save(folder)
    assert session.finish() == tmp_path / "out"


def test_after_a_reset_labels_and_frames_begin_anew(session: Session, frames: list[Frame], tmp_path: Path) -> None:
    session.name(1, "mug")
    session.reset()
    assert (session.query(), session.names) == ([], {})
    with pytest.raises(InputError, match="nothing to save"):
        session.save()
    for frame in frames:
        session.take(Frame(frame.index + 500, frame.timestamp_s, frame.color, frame.depth_m, frame.T_world_camera))
    assert [item.label for item in session.query()] == [1, 2]
    session.save()
    assert cuboid.open_results(tmp_path / "out").report.skipped == ()
    assert session.used == 24


def test_a_frame_without_its_pose_is_counted(session: Session, frames: list[Frame]) -> None:
    bare = Frame(50, 9.0, frames[0].color, frames[0].depth_m)
    assert isinstance(session.take(bare), SkippedFrame)
    assert (session.used, session.skipped) == (12, 1)


def test_a_folder_that_exists_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="exists; --force"):
        session_of(tmp_path)
    session_of(tmp_path, force=True)
    assert session_of(None).finish() is None
    with pytest.raises(InputError, match="without --output"):
        session_of(None).save()


def test_a_command_is_done_or_says_why_not(session: Session) -> None:
    parameters = Parameters(lambda settings: None)

    def said(command: object) -> tuple[bool, str]:
        done = answer(command, session, parameters)  # type: ignore[arg-type]
        return done.success, done.message

    assert said(Query()) == (True, "2 objects")
    assert said(Name(label=1, name="mug")) == (True, "#1 is called 'mug'")
    assert said(Query(name="mug")) == (True, "1 objects")
    assert said(Cloud(label=77))[0] is False
    assert said(Cloud())[0] is True
    assert said(Save())[0] is True
    assert said(Set(parameter="min_probability", value=2)) == (
        False,
        "parameter min_probability: expected a number from 0 to 1, got 2",
    )
    assert answer(Set(parameter="object_frames", value=True), session, parameters).parameters == {
        "object_frames": True,
        "min_probability": 0.0,
        "map_every_s": 0.0,
    }
    assert answer(ListParameters(), session, parameters).parameters == parameters.values
    assert said(Reset()) == (True, "the map is empty")
    assert said(Query()) == (True, "0 objects")


def test_parameters_have_types_and_ranges() -> None:
    applied: list[StreamSettings] = []
    parameters = Parameters(applied.append)
    parameters.set_texts(["object_frames=true", "min_probability=0.5", "map_every_s=2"])
    assert applied[-1] == StreamSettings(object_frames=True, min_probability=0.5, map_every_s=2.0)
    for text, part in (
        ("min_probability", "expected NAME=VALUE"),
        ("min_probability=x", "expected true, false or a number"),
        ("min_probability=true", "Expected `float`"),
        ("min_probability=1.5", "from 0 to 1"),
        ("map_every_s=-1", "from 0 to inf"),
        ("object_frames=1", "Expected `bool`"),
        ("speed=1", "there is no parameter 'speed'; expected one of object_frames"),
    ):
        with pytest.raises(InputError, match=part):
            parameters.set_texts([text])
    assert len(applied) == 3
